"""Packs telemetry messages of the built-in autopilots: gives the state of the vehicles to the kernel `telemetry_packing`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.control.controllers import Cascade
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.flight_modes import MANUAL_MODES, STANDARD_MODES, Mode
from arena.autopilot.mavlink.packed_messages import writers
from arena.autopilot.mavlink.telemetry_state import boot_ms
from arena.autopilot.vehicle import Vehicle
from arena.geometry import EARTH_M
from arena.kernels.arrays import array, flags, integers, new_integers, view
from arena.kernels.global_coordinates import global_position
from arena.kernels.telemetry_packing import TelemetryPacking
from arena.kernels.telemetry_quantities import HOME, MODES, PLACE, STATUS

Array = NDArray[np.float64]
_NAN = float("nan")


class TelemetryPacker:
    """Packs the telemetry messages of the table `PACKED`, of V vehicles with at most R rotors each.

    Use `begin` once per step, before `pack`.

    est, sp, cascade: estimator, setpoints and controllers of the vehicles
    thrust, motors: collective thrust (V,) and motor commands (V, R) 0..1
    consumed_mah: consumed charge [mAh] (V,)
    links: number of MAVLink links of all vehicles
    boot_unix_us: Unix time of the boot [us]
    law: the compiled packing
    """

    def __init__(
        self,
        est: Estimator,
        sp: Setpoints,
        cascade: Cascade,
        thrust: Array,
        motors: Array,
        consumed_mah: Array,
        *,
        links: int,
        boot_unix_us: int,
    ) -> None:
        self.law = packing = TelemetryPacking(
            view(thrust),
            view(motors),
            view(consumed_mah),
            new_integers(links),
            *writers(),
            EARTH_M,
            boot_unix_us,
        )
        inputs, place = array(packing.inputs), len(STATUS) + len(PLACE)
        self._status, self._place, self._lost = np.split(inputs, [len(STATUS), place], axis=1)
        rare, home = array(packing.rare_inputs), len(MODES) + len(HOME)
        self._modes, self._home, self._events = np.split(rare, [len(MODES), home], axis=1)
        self._xy_valid, self._escs = est.xy_valid, array(packing.escs)
        self._baro_alt = array(packing.baro_alt)
        self._mag_b = array(packing.mag_b)
        self._battery_v, self._battery_a = array(packing.battery_v), array(packing.battery_a)
        self._battery = array(packing.battery)
        packing.read_estimates_from(
            view(est.sensed_accel_b),
            view(est.sensed_gyro_b),
            view(est.p_n),
            view(est.v_n),
            view(est.q_nb),
            view(est.r_nb),
            view(est.omega_b),
            view(est.cov),
            integers(est.reset_counter),
            flags(est.xy_valid(0.0)),
        )
        packing.read_validity_from(flags(est.z_valid(0.0)), view(est.test_ratio))
        position = cascade.position
        used = (sp.p_n, sp.yaw, sp.yaw_rate, position.v_sp_n, position.a_sp_n, cascade.q_sp, cascade.omega_sp)
        packing.read_setpoints_from(integers(sp.level), *(view(each) for each in used))

    def begin(self, now: float, sensors: Mapping[str, Array]) -> None:
        """Copy time and sensor values of this step to the compiled packer of telemetry.

        The compiled packer reads the other values from the arrays of the autopilots.

        now: time since boot [s]
        sensors: as for `Autopilots.step`, whose accelerations and body rates the estimator has stored
        """
        self._mag_b[...], self._baro_alt[...] = sensors["mag_b"], sensors["baro_alt_m"]
        self._battery_v[...], self._battery_a[...] = sensors["battery_v"], sensors["battery_current_a"]
        self._battery[...] = sensors["battery_remaining"]
        self._xy_valid(now)
        self.law.set_time(boot_ms(now), int(now * 1e6), int(now * 1e9))

    def pack(self, v: Vehicle, message_ids: list[int], link: int, seq: int) -> bytes:
        """Return the encoded frames of several messages of a vehicle.

        link: row of the link, which numbers the PINGs
        seq: sequence number of the first frame
        """
        return self.law.pack(v.row, message_ids, link, seq, v.system_id, 1)

    def frame_count(self, v: Vehicle, message_ids: list[int]) -> int:
        """Return how many frames `pack` returns for several messages of a vehicle."""
        return self.law.frame_count(v.row, message_ids)

    def set_status(self, v: Vehicle) -> None:
        """Copy mode, arming state, health and battery thresholds of a vehicle to the compiled packer (attribute `law`)."""
        c, p = v.commander, v.commander_params
        present, lost = _present(v, xy_valid=True), _present(v, xy_valid=False)
        self._status[v.row] = (
            v.mav_type,
            c.mode.custom_mode,
            _base_mode(v),
            _status(v),
            v.landed_state,
            present,
            _health(v, present),
        )
        self._lost[v.row] = lost, _health(v, lost & ~mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION)
        self._modes[v.row] = (
            c.intended.custom_mode,
            STANDARD_MODES.get(c.mode, 0),
            v.aligned,
            p.bat_low_thr,
            p.bat_crit_thr,
            p.bat_emergen_thr,
        )

    def set_place(self, v: Vehicle) -> None:
        """Copy a vehicle's arming state, origin, home and number of rotors to the compiled packer (attribute `law`)."""
        self._escs[v.row] = v.rotors
        lat, lon, alt, _ = v.origin or (_NAN, _NAN, _NAN, 0.0)
        north, east, home_d = v.home_n or (_NAN, _NAN, _NAN)
        self._place[v.row] = v.commander.armed, lat, lon, alt, v.heading, home_d
        home = global_position(north, east, v.heading, lat, lon, EARTH_M)
        self._home[v.row] = *home, (alt - home_d) * 1e3, north, east

    def set_newest_event(self, v: Vehicle, sequence: int, flags: int) -> None:
        """Copy the number of a vehicle's newest event, and the flags of CURRENT_EVENT_SEQUENCE, to the compiled packer."""
        self._events[v.row] = sequence, flags


def _base_mode(v: Vehicle) -> int:
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
        mavlink.MAV_MODE_FLAG_SAFETY_ARMED if v.commander.armed else 0
    )
    mode = v.commander.mode
    if mode is not Mode.ACRO:
        base |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    if mode in MANUAL_MODES:
        base |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    elif mode is not Mode.OFFBOARD:
        base |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    return int(base)


def _status(v: Vehicle) -> int:
    c = v.commander
    if c.mode is Mode.TERMINATE:
        return int(mavlink.MAV_STATE_FLIGHT_TERMINATION)
    return int(
        mavlink.MAV_STATE_CRITICAL
        if c.failsafe
        else mavlink.MAV_STATE_ACTIVE
        if c.armed
        else mavlink.MAV_STATE_STANDBY
    )


_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION
    | mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
    | mavlink.MAV_SYS_STATUS_AHRS
)


def _present(v: Vehicle, *, xy_valid: bool) -> int:
    """Return the sensors that a vehicle has, as MAV_SYS_STATUS_SENSOR bits.

    xy_valid: the horizontal position is valid
    """
    bits = (
        # SDKs interpret the GPS bit as "the global position is valid", whatever its source.
        (mavlink.MAV_SYS_STATUS_SENSOR_GPS, _has_origin(v) and xy_valid),
        (mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL, xy_valid),
        (mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, v.inputs.manual_control),
        (mavlink.MAV_SYS_STATUS_LOGGING, v.is_logged),
    )
    return int(_SENSORS | sum(bit for bit, has in bits if has))


def _health(v: Vehicle, working: int) -> int:
    """Return the working sensors and the arming checks as MAV_SYS_STATUS_SENSOR bits.

    As in PX4, logging is healthy whether a log is written or not.
    """
    ready = mavlink.MAV_SYS_STATUS_PREARM_CHECK if v.ready_to_arm else 0
    return int(working | mavlink.MAV_SYS_STATUS_LOGGING | ready)


def _is_aligned(v: Vehicle) -> bool:
    """Return whether the estimator is initialised.

    From then on the position is sent even if it is not valid, as in PX4.
    """
    return v.aligned


def _has_origin(v: Vehicle) -> bool:
    return v.origin is not None


def _has_home(v: Vehicle) -> bool:
    return v.home_n is not None and _has_origin(v)


HAS_CONTENT: dict[int, Callable[[Vehicle], bool]] = {
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _is_aligned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _has_origin,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _has_origin,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: _has_home,
}
"""Message id -> function that returns whether a vehicle has content for the message. All other messages always have content."""
NEEDS_POSITION = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
    mavlink.MAVLINK_MSG_ID_ODOMETRY,
}
"""Ids of messages that are sent only while the horizontal position is valid."""
