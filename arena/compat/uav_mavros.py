"""Class `UAV` with the method names, arguments and units of the MAVROS class of the ISR Flying Arena thesis."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from arena import uav as arena_uav
from arena.compat import command_line, thread_clocks
from arena.compat.columns import Columns
from arena.compat.stale_reads import LIMIT_S, StaleReads
from arena.errors import InputError, NotConfirmedError
from arena.geometry import Array
from arena.uav.arguments import read_arguments
from arena.uav.setpoints import AttitudeKind

CONNECTION_TIMEOUT_S = 20.0
VEHICLES: dict[str, arena_uav.UAV] = {}
"""Vehicles that this program has opened, by name."""


class UAV:
    """Vehicle with the methods that programs of the ISR Flying Arena thesis (MAVROS) use to fly it.

    drone_ns: name of the vehicle.
    mass: [kg]. radius, height: [m]. num_rotors: number. All of them may be text, as on the command line.
    thrust_curve: name of the vehicle's type. The curve itself is that of its profile.
    The constructor waits until telemetry arrives. Raises NotConfirmedError if none has arrived after 20 s.
    Raises InputError if `arena up` has started this program for another vehicle.

    `ekf`, `sen`, `act` and `info` have the names and units of the thesis: vectors are columns (3, 1), `sen.emu.rel_pos` and
    `sen.emu.rel_vel` are (n, 3, 1), latitude and longitude are in radians, `act.output` is a list. A value stays the last one that
    arrived, however old it is, and is None before its first arrival.

    Three things differ from the thesis. A setter raises StaleDataError if its thread has read a value of `ekf`, `sen.mocap` or
    `sen.emu` that was older than 1 s since the last setpoint: nothing is sent, and the offboard failsafe acts. A command that the
    autopilot refuses raises CommandRefusedError instead of a line in the log. A setter raises OffboardLostError when a pilot or a
    failsafe has taken the vehicle.

    reads: values that were too old when the program read them.
    """

    def __init__(
        self,
        drone_ns: str,
        mass: str | float,
        radius: str | float,
        height: str | float,
        num_rotors: str | int,
        thrust_curve: str,
    ) -> None:
        selected = command_line.vehicle_name()
        if selected not in (None, drone_ns):
            raise InputError(
                f"UAV({drone_ns!r}, ...): `arena up` has started this program for {selected}, "
                f"so it cannot fly {drone_ns}. Use UAV({selected!r}, ...)"
            )
        settings = read_arguments(command_line.uav_options(drone_ns))
        if settings["clock"] is not None:
            settings["clock"] = thread_clocks.use(settings["clock"])
        self._uav = VEHICLES[drone_ns] = arena_uav.UAV(**settings)
        if not self._uav.hold_until(self._has_data, CONNECTION_TIMEOUT_S):
            raise NotConfirmedError(
                f"{drone_ns}: no telemetry of the vehicle after {CONNECTION_TIMEOUT_S:g} s"
            )
        last, fresh = self._uav.last_values(), self._uav.last_values(LIMIT_S)
        self.reads = reads = StaleReads()
        self.ekf = Columns(last.ekf, fresh=fresh.ekf, reads=(reads, "ekf"))
        self.sen = Columns(
            last.sen,
            imu=Columns(last.sen.imu),
            mocap=Columns(last.sen.mocap, fresh=fresh.sen.mocap, reads=(reads, "sen.mocap")),
            gps=Columns(last.sen.gps, pos=lambda: _in_radians(last.sen.gps.pos)),
            baro=Columns(last.sen.baro),
            emu=Columns(last.sen.emu, fresh=fresh.sen.emu, reads=(reads, "sen.emu")),
        )
        self.act = Columns(last.act, output=lambda: list(last.act.output))
        self.info = Columns(
            last.info,
            drone_ns=drone_ns,
            mass=float(mass),
            radius=float(radius),
            height=float(height),
            num_rotors=int(num_rotors),
            thrust_curve=thrust_curve,
            is_connected=lambda: self._uav.info.is_connected,
        )

    def arm_drone(self) -> None:
        """Arm the vehicle, and wait until the vehicle confirms it.

        Raises CommandRefusedError.
        """
        self._uav.arm_drone()

    def disarm_drone(self) -> None:
        """Disarm the vehicle, and wait until the vehicle confirms it.

        Raises CommandRefusedError if the autopilot refuses, as it does in the air.
        """
        self._uav.disarm_drone()

    def start_offboard_mode(self) -> None:
        """Enter OFFBOARD at the current position, and wait for the confirmation.

        Raises CommandRefusedError.
        """
        self.reads.clear()
        self._uav.start_offboard_mode()

    def start_offboard_mission(self) -> None:
        """Wait until the vehicle is ready, enter OFFBOARD, and arm.

        Raises CommandRefusedError, or NotConfirmedError after 20 s.
        """
        self.reads.clear()
        self._uav.start_offboard_mission()

    def auto_land(self) -> None:
        """Start the landing at the current position.

        Return when the autopilot is in AUTO.LAND. The vehicle then still descends.
        """
        self._uav.auto_land(wait=False)

    def set_pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, time: ArrayLike) -> None:
        """Send a position setpoint at 50 Hz for a number of seconds.

        pos: [m] [NED] (3, 1). yaw: [rad]. time: [s].
        """
        self.reads.check()
        self._uav.set_pos_yaw(pos, yaw, time)

    def set_vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint, then wait until the next one is due at the rate `freq`.

        vel: [m/s] [NED] (3, 1). yaw: [rad]. freq: [Hz].
        """
        self.reads.check()
        self._uav.set_vel_yaw(vel, yaw, freq)

    def set_vel_body_yaw_rate(self, vel_body: ArrayLike, yaw_rate: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint in vehicle axes (FRD), then wait until the next one is due at the rate `freq`.

        vel_body: forward, right, down [m/s] (3, 1). yaw_rate: [rad/s]. freq: [Hz].
        """
        self.reads.check()
        self._uav.set_vel_body_yaw_rate(vel_body, yaw_rate, freq)

    def set_att_thrust(
        self, att: ArrayLike, att_type: AttitudeKind, thrust: ArrayLike, freq: ArrayLike
    ) -> None:
        """Send an attitude and thrust setpoint, then wait until the next one is due at the rate `freq`.

        att: roll, pitch, yaw [rad] (3, 1) for att_type "euler", q_nb wxyz (4, 1) for "quaternion". thrust: [N]. freq: [Hz].
        """
        self.reads.check()
        self._uav.set_att_thrust(att, att_type, thrust, freq)

    def set_ang_vel_thrust(self, ang_vel: ArrayLike, thrust: ArrayLike, freq: ArrayLike) -> None:
        """Send a setpoint of angular rates and thrust, then wait until the next one is due at the rate `freq`.

        ang_vel: [rad/s] [FRD] (3, 1). thrust: [N]. freq: [Hz].
        """
        self.reads.check()
        self._uav.set_ang_vel_thrust(ang_vel, thrust, freq)

    def set_act(self, group: int, output: ArrayLike, freq: ArrayLike) -> None:
        """Send an actuator setpoint, then wait until the next one is due at the rate `freq`.

        Raises CommandRefusedError for autopilots newer than PX4 v1.13.

        group: mixer group 0..3. output: up to 8 numbers -1..1 [-]. freq: [Hz].
        """
        self.reads.check()
        self._uav.set_act(group, output, freq)

    def _has_data(self) -> bool:
        return self._uav.info.is_connected and math.isfinite(self._uav.ekf.age_s)


def _in_radians(pos: Array) -> Array:
    """Convert latitude and longitude from degrees to radians; keep the altitude.

    pos: latitude, longitude, altitude [m] (3,).
    """
    return np.array([*np.radians(pos[:2]), pos[2]])
