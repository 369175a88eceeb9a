"""From where a vehicle is to where it shall be: a point that runs ahead of it, limited in speed, acceleration and jerk."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

_SETTLE = 3.0  # how fast a wanted velocity is turned into acceleration [1/s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """cruise, up, down [m/s]; accel, accel_up, accel_down [m/s2]; jerk [m/s3]; turn [rad/s]; lead_m: no further ahead."""

    cruise: float
    up: float
    down: float
    accel: float
    accel_up: float
    accel_down: float
    jerk: float
    turn: float
    lead_m: float = 2.0


@dataclass(slots=True)
class Course:
    """p_n [m], v_n [m/s], a_n [m/s2] [NED] of the running point; yaw [rad] of the heading that turns with it."""

    p_n: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    v_n: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    a_n: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    yaw: float = 0.0

    def begin(self, p_n: Sequence[float], v_n: Sequence[float], yaw: float) -> None:
        """Start from where the vehicle is, as it moves."""
        self.p_n, self.v_n, self.a_n, self.yaw = list(p_n), list(v_n), [0.0, 0.0, 0.0], yaw

    def run(self, to: Sequence[float], here: Sequence[float], pace: Pace, dt: float) -> None:
        """One step towards `to` [m] [NED]; here: where the vehicle is."""
        if math.dist(self.p_n, here) > pace.lead_m:
            self.v_n, self.a_n = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]  # wait for it
            return
        self._run_level(to, pace, dt)
        self._run_down(to[2], pace, dt)
        for k in range(3):
            self.v_n[k] += self.a_n[k] * dt
            self.p_n[k] += self.v_n[k] * dt

    def turn(self, yaw: float, pace: Pace, dt: float) -> None:
        """Turn towards yaw [rad]; NaN leaves it."""
        if math.isfinite(yaw):
            left, most = wrapped(yaw - self.yaw), pace.turn * dt
            self.yaw = wrapped(self.yaw + min(max(left, -most), most))

    def _run_level(self, to: Sequence[float], pace: Pace, dt: float) -> None:
        left = (to[0] - self.p_n[0], to[1] - self.p_n[1])
        distance = math.hypot(*left)
        speed = min(pace.cruise, _approach(distance, pace.accel, pace.jerk))
        scale = speed / distance if distance > 1e-6 else 0.0
        wanted = _short([_SETTLE * (left[k] * scale - self.v_n[k]) for k in (0, 1)], pace.accel)
        change = _short([wanted[k] - self.a_n[k] for k in (0, 1)], pace.jerk * dt)
        self.a_n[0] += change[0]
        self.a_n[1] += change[1]

    def _run_down(self, to: float, pace: Pace, dt: float) -> None:
        left = to - self.p_n[2]
        cruise, accel = (pace.down, pace.accel_down) if left > 0 else (pace.up, pace.accel_up)
        speed = math.copysign(min(cruise, _approach(abs(left), accel, pace.jerk)), left)
        wanted = min(max(_SETTLE * (speed - self.v_n[2]), -accel), accel)
        most = pace.jerk * dt
        self.a_n[2] += min(max(wanted - self.a_n[2], -most), most)


def _approach(distance: float, accel: float, jerk: float) -> float:
    """The speed from which one can stop at a point this far off: v^2 / 2a, and 2a/j in which the brakes are applied."""
    b = 4.0 * accel * accel / jerk
    return 0.5 * (math.sqrt(b * b + 8.0 * accel * distance) - b)


def _short(v: list[float], most: float) -> list[float]:
    length = math.hypot(*v)
    return v if length <= most else [x * most / length for x in v]


def wrapped(angle: float) -> float:
    """[rad] into -pi .. pi."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
