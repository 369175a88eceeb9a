"""A vehicle that somebody carries by hand, for tests: its attitude and position, its inertial sensors, its captured body."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from arena.constants import GRAVITY_M_S2
from arena.geometry import quat_conj, quat_from_euler, quat_rotate
from arena.kernels import rotations

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
MOTION_S = 12.0
_STEP_S = 1e-3


def axes(roll_deg: float = 0.0, pitch_deg: float = 0.0, yaw_deg: float = 0.0):
    """Return the attitude of a captured body in its vehicle, defined with wrong axes [-] wxyz."""
    return quat_from_euler(np.radians([roll_deg, pitch_deg, yaw_deg]))


def ramp(t: float, begin: float, seconds: float) -> float:
    """Return 0 before `begin`, 1 after `seconds` more, and a smooth transition between."""
    x = min(max((t - begin) / seconds, 0.0), 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


def pulse(t: float, begin: float, there: float, hold: float) -> float:
    return ramp(t, begin, there) - ramp(t, begin + there + hold, there)


def from_euler(roll: float, pitch: float, yaw: float):
    """Return the attitude of Euler angles [rad]. A kernel, because a carried vehicle needs hundreds of thousands."""
    return np.array(rotations.from_euler(roll, pitch, yaw))


def multiply(a, b):
    """Return the product of two quaternions (4,)."""
    return np.array(rotations.product(tuple(a.tolist()), tuple(b.tolist())))


@dataclass(kw_only=True, eq=False)
class Motion:
    """The guided motion: it begins at `begin` [s] and lasts MOTION_S at `pace` 1. Before and after, the vehicle stands.

    pace: slower motion for less than 1
    tilt_deg: largest tilt
    yaw_deg: heading
    start: position [m] [NED]
    """

    begin: float = 2.0
    pace: float = 1.0
    tilt_deg: float = 45.0
    yaw_deg: float = 30.0
    start: tuple[float, float, float] = (0.4, -1.2, -0.1)

    def hand(self, t: float) -> float:
        """Return how firmly the vehicle is in the hand, 0 (on the floor) to 1."""
        return pulse((t - self.begin) * self.pace, 0.0, 1.0, MOTION_S - 3.0)

    @lru_cache(maxsize=64)  # noqa: B019  sensors and cameras ask for the attitude of the same moments
    def q_nb(self, t: float):
        s, held = (t - self.begin) * self.pace, self.hand(t)
        nose = -math.radians(self.tilt_deg) * pulse(s, 2.0, 0.8, 0.7)
        right = math.radians(self.tilt_deg) * pulse(s, 5.5, 0.8, 0.7)
        shake = [0.03 * math.sin(5.1 * t), 0.03 * math.sin(4.3 * t + 1.0), 0.1 * math.sin(0.9 * t)]
        return from_euler(
            right + held * shake[0], nose + held * shake[1], math.radians(self.yaw_deg) + held * shake[2]
        )

    def p_n(self, t: float):
        held = self.hand(t)
        sway = held * np.array([0.15 * math.sin(1.3 * t), 0.1 * math.sin(1.7 * t), -0.5])
        return np.array(self.start) + sway

    def imu(self, t: float):
        """Return specific force [m/s2] [FRD] and rotation rate [rad/s] [FRD]."""
        q, h = self.q_nb(t), _STEP_S
        between = multiply(quat_conj(q), self.q_nb(t + h))
        rate = 2.0 * between[1:] / h * math.copysign(1.0, between[0])
        accel_n = (self.p_n(t + 20 * h) - 2.0 * self.p_n(t) + self.p_n(t - 20 * h)) / (20 * h) ** 2
        return quat_rotate(quat_conj(q), accel_n - np.array([0.0, 0.0, GRAVITY_M_S2])), rate


STANDING = Motion(begin=math.inf)


def mirrored_y(q):
    """Return the attitude that a capture system with a reversed east axis reports."""
    w, x, y, z = q
    return np.array([w, -x, y, -z])


def mirrored_z(q):
    """Return the attitude that a capture system with a reversed vertical axis reports."""
    w, x, y, z = q
    return np.array([w, -x, -y, z])


@dataclass(kw_only=True)
class Captured:
    """A rigid body of the cameras. moves: the vehicle that it is fixed to. axes: its wrong axes.

    seen: function of time that returns whether the cameras see the body
    """

    moves: Motion
    axes: np.ndarray = field(default_factory=lambda: LEVEL)
    mirror: Callable[[np.ndarray], np.ndarray] = lambda q: q
    noise_deg: float = 0.05
    seen: Callable[[float], bool] = lambda t: True

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(1)

    def q_nb(self, t: float):
        noise = from_euler(*self._rng.normal(0.0, math.radians(self.noise_deg), 3).tolist())
        return self.mirror(multiply(multiply(self.moves.q_nb(t), self.axes), noise))

    def p_n(self, t: float):
        return self.moves.p_n(t)
