"""The class a program flies with. Its data are groups (`groups.py`), its commands a `Pilot`, its wire a `Connection`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock, WallClock
from arena.errors import CommandRefusedError, StaleDataError
from arena.thrust_curve import thrust_curve as curve_of
from arena.uav.connection import Capture, Connection
from arena.uav.data_groups import Actuation, Body, Ekf, Info, Sensors, Snapshot, Source
from arena.uav.heartbeat import Heart
from arena.uav.poses import Poses
from arena.uav.setpoints import AttitudeKind, attitude, duration_s, period_s, scalar, vector
from arena.uav.vehicle_control import STREAM_HZ, Pilot

_LAST_WITH_ACTUATOR_CONTROL = 1, 13


class UAV:
    """One vehicle, simulated or real: the program cannot tell which.

    ns: the vehicle's name; mass [kg]; radius, height [m]; thrust_curve: the profile's settings (see `arena.thrust_curve`).
    link: "udpin:HOST:PORT", where the vehicle's MAVLink comes in; system_id: its MAV_SYS_ID.
    capture: settings of the motion capture, or of several; body: its own name there (default: ns).
    neighbours: names, or (name, body) pairs.
    clock: what `time` and `freq` are counted by; the wall clock by default. stale_s: data older than this raise.
    heart: where a copilot listens for heartbeats, which leave in calls of its methods alone.

    Setpoints leave only while one of its methods runs. A program that stops calling them goes silent, and the autopilot's
    offboard failsafe lands the vehicle. Nothing is commanded when it is closed.
    """

    def __init__(  # noqa: PLR0913 the thesis's signature, and where to find the vehicle
        self,
        ns: str,
        mass: float,
        radius: float,
        height: float,
        num_rotors: int,
        thrust_curve: Mapping[str, Any],
        *,
        link: str,
        system_id: int,
        capture: Capture | None = None,
        body: str | None = None,
        clock: Clock | None = None,
        neighbours: Sequence[str | tuple[str, str]] = (),
        stale_s: float = 0.5,
        heart: tuple[str, int] | None = None,
        args: Sequence[str] = (),
    ) -> None:
        self.clock: Clock = WallClock() if clock is None else clock
        self.args = list(args)
        self._curve = curve_of(thrust_curve)
        pairs = [(n, n) if isinstance(n, str) else n for n in neighbours]
        poses = Poses((body or ns) if capture else None, pairs if capture else ())
        self._link = Connection(link, system_id, self.clock, poses, capture)
        self._source = Source(
            ns=ns,
            stale_s=stale_s,
            telemetry=self._link.telemetry,
            poses=poses,
            now=self.clock.now,
            refresh=self._link.refresh,
        )
        self._body = Body(
            ns=ns, mass=mass, radius=radius, height=height, num_rotors=num_rotors, thrust_curve=thrust_curve
        )
        self._heart = Heart(heart, system_id, self.clock)
        self._pilot = Pilot(self._source, self._link, self.clock, system_id, self._heart)
        live = Snapshot.of(self._source, self._body)
        self.ekf: Ekf = live.ekf
        self.sen: Sensors = live.sen
        self.act: Actuation = live.act
        self.info: Info = live.info
        self._due = -np.inf

    @classmethod
    def from_args(cls, argv: Sequence[str] | None = None) -> UAV:
        """What the supervisor passes, or what one types: `--ns uav1 --id 1 --link udpin:127.0.0.1:16001 --profile iris`.

        Arguments that it does not know are the program's own: `uav.args`.
        """
        from arena.uav.arguments import read_arguments

        return cls(**read_arguments(argv))

    def snapshot(self) -> Snapshot:
        """The same groups, fixed at this instant: values that belong together."""
        return Snapshot.of(self._source.fixed(), self._body)

    def arm_drone(self) -> None:
        """Arm, confirmed. Raises CommandRefusedError with the autopilot's reasons."""
        self._pilot.arm()

    def disarm_drone(self) -> None:
        """Disarm, confirmed. The autopilot refuses in the air."""
        self._pilot.disarm()

    def start_offboard_mode(self) -> None:
        """OFFBOARD, confirmed, at the place where the vehicle is; setpoints flow throughout."""
        self._pilot.enter_offboard()

    def start_offboard_mission(self) -> None:
        """Wait until the vehicle is ready (20 s at most), then OFFBOARD, then armed: each confirmed, never silent."""
        self._pilot.take()

    def auto_land(self) -> None:
        """Land here; returns when the vehicle is on the ground and disarmed. Raises NotConfirmedError after 60 s."""
        self._pilot.land()

    def set_pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, time: ArrayLike) -> None:
        """Fly to pos [m] [NED] (3,) at yaw [rad]; blocks for `time` [s], streaming at 50 Hz."""
        end = self.clock.now() + duration_s(time)
        rate = self.clock.rate(STREAM_HZ)
        while True:
            now = self.clock.now()
            self._pilot.send(self._pilot.encoder.pos_yaw(pos, yaw, now))
            if now + 1.0 / STREAM_HZ >= end:
                break
            rate.sleep()
        self.clock.sleep_until(end)

    def set_vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, freq: ArrayLike) -> None:
        """vel [m/s] [NED] (3,); yaw [rad]. Sends once, then waits until 1/freq has passed since the last send."""
        self._send(self._pilot.encoder.vel_yaw(vel, yaw, self.clock.now()), freq)

    def set_vel_body_yaw_rate(self, vel_body: ArrayLike, yaw_rate: ArrayLike, freq: ArrayLike) -> None:
        """vel_body: forward, right, down [m/s] (3,), level whatever the tilt; yaw_rate [rad/s]. Sends once, waits 1/freq."""
        self._send(self._pilot.encoder.vel_body_yaw_rate(vel_body, yaw_rate, self.clock.now()), freq)

    def set_att_thrust(
        self, att: ArrayLike, att_type: AttitudeKind, thrust: ArrayLike, freq: ArrayLike
    ) -> None:
        """att: "euler" roll, pitch, yaw [rad] (3,) or "quaternion" wxyz (4,); thrust [N], clamped. Sends once, waits 1/freq."""
        q_nb = attitude(att, att_type)
        self._send(self._pilot.encoder.att_thrust(q_nb, self._normalised(thrust), self.clock.now()), freq)

    def set_ang_vel_thrust(self, ang_vel: ArrayLike, thrust: ArrayLike, freq: ArrayLike) -> None:
        """ang_vel: body rates [rad/s] [FRD] (3,); thrust [N], clamped. Sends once, waits 1/freq."""
        rates = vector(ang_vel, "ang_vel")
        self._send(
            self._pilot.encoder.ang_vel_thrust(rates, self._normalised(thrust), self.clock.now()), freq
        )

    def set_act(self, group: int, output: ArrayLike, freq: ArrayLike) -> None:
        """output: up to 8 numbers, -1..1, for a mixer group. PX4 up to v1.13 only: others would ignore it in silence."""
        message = self._pilot.encoder.act(group, output, self.clock.now())
        period_s(freq)
        version = self._source.telemetry.version or self._pilot.ask_version()
        if version is None or version[:2] > _LAST_WITH_ACTUATOR_CONTROL:
            who = (
                "does not tell its version"
                if version is None
                else f"is v{version[0]}.{version[1]}.{version[2]}"
            )
            raise CommandRefusedError(
                f"{self.info.drone_ns}: set_act needs PX4 v1.13 or older, which take SET_ACTUATOR_CONTROL_TARGET; this autopilot "
                f"{who}. Use set_ang_vel_thrust"
            )
        self._send(message, freq)

    def close(self) -> None:
        """Close the link. Commands nothing: a vehicle in the air meets its offboard failsafe."""
        self._link.close()
        self._heart.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _send(self, message: mavlink.MAVLink_message, freq: ArrayLike) -> None:
        period = period_s(freq)
        self._pilot.send(message)
        now = self.clock.now()
        # absolute deadlines, so that the rate does not drift; a pause of more than a period starts them anew
        self._due = self._due + period if 0.0 <= now - self._due < period else now + period
        self.clock.sleep_until(self._due)

    def _normalised(self, thrust: ArrayLike) -> float:
        """thrust [N] -> 0..1 at the present speed; at rest where the speed is not known."""
        newtons = max(0.0, scalar(thrust, "thrust"))
        try:
            speed = float(np.linalg.norm(self.ekf.vel))
        except StaleDataError:
            speed = 0.0
        return float(self._curve.command(newtons, speed))
