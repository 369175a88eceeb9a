"""Filter that estimates the velocity of a rigid body from its captured positions. Pure.

A filter with constant gains for position, velocity and acceleration (alpha-beta-gamma filter). The gains are those of the Kalman
filter for white noise of the position and for an acceleration that changes randomly between frames:
P. R. Kalata, "The tracking index: a generalized parameter for alpha-beta and alpha-beta-gamma target trackers",
IEEE Transactions on Aerospace and Electronic Systems, 1984.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from arena.portable_math import product

Triple = tuple[float, float, float]

JERK_M_S3 = 20.0
"""Assumed change of the acceleration per second [m/s3]: a multirotor that starts or stops."""
MIN_NOISE_M = 1e-4
MAX_GAP_S = 0.1
"""Longest time without a pose over which the filter continues [s]."""
SETTLING_FRAMES = 40
"""Number of poses after a start of the filter until its velocity is used."""


class Motion(NamedTuple):
    """Position [m] and velocity [m/s] of a body [NED]."""

    p_n: Triple
    v_n: Triple


class Gains(NamedTuple):
    """Filter gains for position [-], velocity [1/s] and acceleration [1/s2].

    A gain multiplies the difference between the measured and the predicted position.
    """

    position: float
    velocity: float
    acceleration: float


@cache
def steady_gains(noise_m: float, period_s: float) -> Gains:
    """Return the gains to which a Kalman filter converges, for a given position noise and frame period.

    noise_m: noise of one position, rms per axis [m].  period_s: time between two frames [s].
    """
    t = period_s
    step = np.array([[1.0, t, 0.5 * t * t], [0.0, 1.0, t], [0.0, 0.0, 1.0]])
    change = np.array([0.5 * t * t, t, 1.0])
    process = np.outer(change, change) * (JERK_M_S3 * t) ** 2
    covariance, gain = np.eye(3), np.zeros(3)
    for _ in range(2000):
        covariance = product(product(step, covariance), step.T) + process
        gain = covariance[:, 0] / (covariance[0, 0] + noise_m**2)
        covariance = covariance - np.outer(gain, covariance[0])
    return Gains(*gain.tolist())


class BodyFilter:
    """Filter that estimates the velocity of one body from its captured positions.

    gains: see `steady_gains`.
    """

    def __init__(self, gains: Gains) -> None:
        self._gains = gains
        self._p: list[float] = []
        self._v, self._a = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        self._time_s, self._frames = 0.0, 0

    def add(self, p_n: Triple, time_s: float) -> Motion | None:
        """Add a captured position [m] [NED] of the body. Return it together with the estimated velocity.

        Return None until the velocity can be used.

        time_s: time of the exposure [s]. After a gap, or if the time goes back, the filter starts again.
        """
        gap_s = time_s - self._time_s
        if not self._p or not 0.0 < gap_s <= MAX_GAP_S:
            self._p, self._v, self._a = list(p_n), [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
            self._time_s, self._frames = time_s, 1
            return None
        self._time_s, self._frames = time_s, self._frames + 1
        for axis in range(3):
            self._correct(axis, p_n[axis], gap_s)
        if self._frames < SETTLING_FRAMES:
            return None
        v = self._v
        return Motion(p_n, (v[0], v[1], v[2]))

    def _correct(self, axis: int, measured: float, gap_s: float) -> None:
        a = self._a[axis]
        predicted = self._p[axis] + gap_s * (self._v[axis] + 0.5 * gap_s * a)
        error, gains = measured - predicted, self._gains
        self._p[axis] = predicted + gains.position * error
        self._v[axis] += gap_s * a + gains.velocity * error
        self._a[axis] += gains.acceleration * error
