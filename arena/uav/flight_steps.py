"""The methods of `UAV` and `AsyncUAV` that send setpoints and wait, as generators that both classes share.

The docstrings of `UAV` and `AsyncUAV` describe the methods.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock
from arena.errors import CommandRefusedError, NotConfirmedError
from arena.geometry import Array
from arena.portable_math import norm
from arena.thrust_curve import ThrustCurve
from arena.trajectories.trajectory import Trajectory
from arena.uav.data_source import Source
from arena.uav.planned_path import PathPublisher
from arena.uav.setpoints import AttitudeKind, attitude, duration_s, period_s, scalar, vector
from arena.uav.start_barrier import StartBarrier
from arena.uav.steps import Steps
from arena.uav.vehicle_control import STREAM_HZ, VehicleControl

_LAST_WITH_ACTUATOR_CONTROL = 1, 13


class FlightSteps:
    """Methods of `UAV` that send setpoints and wait, as generators: each yields the times until which it waits.

    control: commands and setpoints of the vehicle.
    barrier: start barrier of the run.
    curve: thrust curve of the vehicle.
    paths: publisher of planned paths.
    """

    def __init__(
        self,
        control: VehicleControl,
        source: Source,
        clock: Clock,
        barrier: StartBarrier,
        curve: ThrustCurve,
        paths: PathPublisher,
    ) -> None:
        self._control, self._source, self._clock = control, source, clock
        self._barrier, self._curve, self.paths = barrier, curve, paths
        self._due = -np.inf

    def pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, time: ArrayLike) -> Steps[None]:
        """Send a position setpoint at STREAM_HZ for `time` seconds.

        pos: [m] [NED] (3,).
        yaw: [rad].
        """
        end = self._clock.now() + duration_s(time)
        self.paths.publish_line(self._position, pos, duration_s(time), self._clock.now())
        due = self._clock.now()
        while True:
            now = self._clock.now()
            self._control.send(self._control.encoder.pos_yaw(pos, yaw, now))
            if now + 1.0 / STREAM_HZ >= end:
                break
            due = max(due + 1.0 / STREAM_HZ, now)
            yield due
        yield end

    def send(self, message: mavlink.MAVLink_message, freq: ArrayLike) -> Steps[None]:
        """Send a setpoint, then wait until the next setpoint is due."""
        period = period_s(freq)
        self._control.send(message)
        now = self._clock.now()
        # absolute deadlines, so that the rate does not drift; a pause of more than a period starts them again
        self._due = self._due + period if 0.0 <= now - self._due < period else now + period
        yield self._due

    def vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, freq: ArrayLike) -> Steps[None]:
        return self.send(self._control.encoder.vel_yaw(vel, yaw, self._clock.now()), freq)

    def pos_vel_yaw(
        self,
        pos: ArrayLike,
        vel: ArrayLike,
        yaw: ArrayLike,
        freq: ArrayLike,
        *,
        acc: ArrayLike | None = None,
        yaw_rate: ArrayLike | None = None,
    ) -> Steps[None]:
        now = self._clock.now()
        return self.send(
            self._control.encoder.pos_vel_yaw(pos, vel, yaw, now, acc=acc, yaw_rate=yaw_rate), freq
        )

    def vel_body_yaw_rate(self, vel_body: ArrayLike, yaw_rate: ArrayLike, freq: ArrayLike) -> Steps[None]:
        return self.send(self._control.encoder.vel_body_yaw_rate(vel_body, yaw_rate, self._clock.now()), freq)

    def att_thrust(
        self, att: ArrayLike, att_type: AttitudeKind, thrust: ArrayLike, freq: ArrayLike
    ) -> Steps[None]:
        q_nb, command = attitude(att, att_type), self._normalised(thrust)
        return self.send(self._control.encoder.att_thrust(q_nb, command, self._clock.now()), freq)

    def ang_vel_thrust(self, ang_vel: ArrayLike, thrust: ArrayLike, freq: ArrayLike) -> Steps[None]:
        rates, command = vector(ang_vel, "ang_vel"), self._normalised(thrust)
        return self.send(self._control.encoder.ang_vel_thrust(rates, command, self._clock.now()), freq)

    def act(self, group: int, output: ArrayLike, freq: ArrayLike) -> Steps[None]:
        """Send an actuator setpoint. Raises CommandRefusedError for autopilots newer than PX4 v1.13."""
        message = self._control.encoder.act(group, output, self._clock.now())
        period_s(freq)
        version = self._source.telemetry.version or (yield from self._control.request_version())
        if version is None or version[:2] > _LAST_WITH_ACTUATOR_CONTROL:
            who = (
                "does not report its version"
                if version is None
                else f"is v{version[0]}.{version[1]}.{version[2]}"
            )
            raise CommandRefusedError(
                f"{self._source.ns}: set_act needs PX4 v1.13 or older, which accepts SET_ACTUATOR_CONTROL_TARGET; this autopilot "
                f"{who}. Use set_ang_vel_thrust"
            )
        yield from self.send(message, freq)

    def follow(self, trajectory: Trajectory, freq: ArrayLike) -> Steps[None]:
        """Send the setpoints of a trajectory until it ends."""
        self.paths.publish_trajectory(trajectory, self._clock.now())
        start = self._clock.now()
        while (t := self._clock.now() - start) < trajectory.duration_s:
            at = trajectory.at(t)
            yield from self.pos_vel_yaw(at.pos, at.vel, at.yaw, freq, acc=at.acc, yaw_rate=at.yaw_rate)
        self.paths.end_trajectory(self._clock.now())

    def wait_for(self, name: str, n: int | None, timeout: ArrayLike) -> Steps[float]:
        """Wait until the other programs of the run have called `wait_for`, too. Return the common start time [s]."""
        limit = duration_s(timeout)
        waiting = self._barrier.arrive(name, self._clock.now(), n)
        try:
            start = yield from self._control.wait_until(lambda: waiting.arrivals().start_s, limit)
        except BaseException:  # control lost, Ctrl-C or cancelled
            waiting.withdraw()  # the others must not start without this vehicle
            raise
        if start is None:
            raise NotConfirmedError(
                f"{self._source.ns}: wait_for({name!r}) timed out after {limit:g} s: {waiting.withdraw()}"
            )
        waiting.start(start)
        return (yield from self.hold_until_time(start))

    def hold_until_time(self, start: float) -> Steps[float]:
        """Hold the position until the time `start` [s] of the clock, and return the time.

        The vehicle holds its position if it is in OFFBOARD.
        """
        yield from self._control.wait_until(
            lambda: self._clock.now() + 1.0 / STREAM_HZ > start, start - self._clock.now()
        )
        yield start
        return start

    def _position(self) -> Array:
        """Return the estimated position [m] [NED] (3,). Raises StaleDataError."""
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.local, "estimated position").pos

    def _normalised(self, thrust: ArrayLike) -> float:
        """Convert a thrust [N] to a motor command 0..1 with the thrust curve at the current airspeed.

        If the airspeed is unknown, 0 m/s is used.
        """
        newtons = max(0.0, scalar(thrust, "thrust"))
        self._source.refresh()
        local = self._source.telemetry.local
        known = local is not None and self._source.age(local) <= self._source.stale_s
        speed = norm(local.vel) if known and local is not None else 0.0
        return float(self._curve.command(newtons, speed))
