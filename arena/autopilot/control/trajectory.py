"""Trajectory to a target: a point that moves ahead of the vehicle with limited speed, acceleration and jerk.

Pure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

_VELOCITY_GAIN = 3.0  # acceleration per velocity error [1/s]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryLimits:
    """Limits of a trajectory: speeds, accelerations, jerk and yaw rate.

    They hold for the point that moves ahead of the vehicle.

    cruise, up, down: horizontal, climb and sink speed [m/s]
    accel, accel_up, accel_down: horizontal, upward and downward acceleration [m/s2]
    jerk: [m/s3]
    yaw_rate: [rad/s]
    lead_m: largest distance between the moving point and the vehicle [m]
    """

    cruise: float
    up: float
    down: float
    accel: float
    accel_up: float
    accel_down: float
    jerk: float
    yaw_rate: float
    lead_m: float = 2.0


@dataclass(slots=True)
class Trajectory:
    """Trajectory of one vehicle: a point that moves ahead of the vehicle, and that the controllers follow.

    p_n [m], v_n [m/s], a_n [m/s2]: position, velocity, acceleration of the point [NED] (3,)
    yaw: heading [rad]
    """

    p_n: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    v_n: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    a_n: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    yaw: float = 0.0

    def begin(self, p_n: Sequence[float], v_n: Sequence[float], yaw: float) -> None:
        """Start the trajectory at the vehicle's position [m], velocity [m/s] [NED] and heading [rad]."""
        self.p_n, self.v_n, self.a_n, self.yaw = list(p_n), list(v_n), [0.0, 0.0, 0.0], yaw

    def advance(
        self, to: Sequence[float], vehicle_n: Sequence[float], limits: TrajectoryLimits, dt: float
    ) -> None:
        """Move the point of the trajectory towards a target for one time step.

        to: target position [m] [NED]
        vehicle_n: position of the vehicle [m] [NED]
        dt: time step [s]
        """
        if math.dist(self.p_n, vehicle_n) > limits.lead_m:
            self.v_n, self.a_n = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]  # wait for the vehicle
            return
        self._advance_horizontally(to, limits, dt)
        self._advance_vertically(to[2], limits, dt)
        for k in range(3):
            self.v_n[k] += self.a_n[k] * dt
            self.p_n[k] += self.v_n[k] * dt

    def turn(self, yaw: float, limits: TrajectoryLimits, dt: float) -> None:
        """Turn the heading of the trajectory towards `yaw` [rad]; NaN keeps the heading.

        dt: time step [s]
        """
        if math.isfinite(yaw):
            left, most = wrap_angle(yaw - self.yaw), limits.yaw_rate * dt
            self.yaw = wrap_angle(self.yaw + min(max(left, -most), most))

    def _advance_horizontally(self, to: Sequence[float], limits: TrajectoryLimits, dt: float) -> None:
        left = (to[0] - self.p_n[0], to[1] - self.p_n[1])
        distance = math.hypot(*left)
        speed = min(limits.cruise, _approach(distance, limits.accel, limits.jerk))
        scale = speed / distance if distance > 1e-6 else 0.0
        wanted = _limit_length(
            [_VELOCITY_GAIN * (left[k] * scale - self.v_n[k]) for k in (0, 1)], limits.accel
        )
        change = _limit_length([wanted[k] - self.a_n[k] for k in (0, 1)], limits.jerk * dt)
        self.a_n[0] += change[0]
        self.a_n[1] += change[1]

    def _advance_vertically(self, to: float, limits: TrajectoryLimits, dt: float) -> None:
        left = to - self.p_n[2]
        cruise, accel = (limits.down, limits.accel_down) if left > 0 else (limits.up, limits.accel_up)
        speed = math.copysign(min(cruise, _approach(abs(left), accel, limits.jerk)), left)
        wanted = min(max(_VELOCITY_GAIN * (speed - self.v_n[2]), -accel), accel)
        most = limits.jerk * dt
        self.a_n[2] += min(max(wanted - self.a_n[2], -most), most)


def _approach(distance: float, accel: float, jerk: float) -> float:
    """Return the greatest speed [m/s] from which a stop within `distance` [m] is possible.

    The stopping distance is v^2 / 2a, plus v * 2a/j while the deceleration builds up.
    """
    b = 4.0 * accel * accel / jerk
    return 0.5 * (math.sqrt(b * b + 8.0 * accel * distance) - b)


def _limit_length(v: list[float], most: float) -> list[float]:
    length = math.hypot(*v)
    return v if length <= most else [x * most / length for x in v]


def wrap_angle(angle: float) -> float:
    """Return the equivalent angle [rad] between -pi and pi."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
