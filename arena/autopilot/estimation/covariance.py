"""Covariance of the estimator's error state: its prediction from IMU samples, and the repair of rounding errors.

The order of the error state is that of the module `estimator`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_V, _TH, _BA = slice(3, 6), slice(6, 9), slice(12, 15)
_PREDICT_S = 0.01  # EKF2_PREDICT_US of PX4 v1.16
_SMALL_VARIANCE = 1e-6
_EYE = np.eye(3)


class CovariancePrediction:
    """Prediction of the covariance of V vehicles, once per prediction period with the mean of its IMU samples.

    PX4 does the same with the samples of its `ImuDownSampler`.

    dt: IMU period [s]
    period_s: prediction period [s]
    growth: variances that each prediction adds to velocity, attitude and both biases (V, 12), set by the caller
    """

    def __init__(self, vehicles: int, dt: float) -> None:
        self._dt, self._every = dt, samples_per_prediction(dt)
        self.period_s = h = dt * self._every
        self.growth = np.zeros((vehicles, 12))
        self._samples = 0
        self._force_sum, self._omega_sum = np.zeros((vehicles, 3)), np.zeros((vehicles, 3))
        self._f = np.tile(np.eye(15), (vehicles, 1, 1))  # error dynamics of one period
        self._f[:, 0, 3] = self._f[:, 1, 4] = self._f[:, 2, 5] = h
        self._f[:, 6, 9] = self._f[:, 7, 10] = self._f[:, 8, 11] = -h

    def advance(self, cov: Array, force_b: Array, omega_b: Array, r_nb: Array) -> Array:
        """Add one IMU sample. Return the predicted covariance at the end of a period, else `cov` itself (V, 15, 15).

        force_b: specific force without bias [m/s2] [FRD] (V, 3)
        omega_b: body rates without bias [rad/s] [FRD] (V, 3)
        r_nb: rotation from body to NED after the sample [-] (V, 3, 3)
        """
        self._force_sum += force_b
        self._omega_sum += omega_b
        self._samples += 1
        if self._samples < self._every:
            return cov
        f, dt = self._f, self._dt
        f[:, _V, _TH] = -dt * (r_nb @ _skew(self._force_sum))
        f[:, _V, _BA] = -self.period_s * r_nb
        f[:, _TH, _TH] = _EYE - dt * _skew(self._omega_sum)
        self._samples = 0
        self._force_sum[:] = self._omega_sum[:] = 0.0
        predicted: Array = f @ cov @ f.transpose(0, 2, 1)
        d = np.einsum("vii->vi", predicted)  # a view of the diagonals
        d[:, 3:] += self.growth
        np.minimum(np.maximum(d, 0.0), 1e4, out=d)
        return predicted


def samples_per_prediction(dt: float) -> int:
    """Return the number of IMU samples in one prediction period. dt: IMU period [s].

    PX4 rounds EKF2_PREDICT_US to a multiple of the IMU period. Its estimate of the IMU period is slightly too large,
    so a half is rounded down (`ImuDownSampler`, computed in 32-bit floats): 8 ms at 250 Hz, 10 ms at 1000 Hz.
    """
    return max(1, math.ceil(_PREDICT_S / dt - 0.5 - 1e-6))


def repaired(cov: Array) -> Array:
    """Return the covariances (m, 15, 15) with each negative variance replaced by a small positive one. Rounding
    errors can make a variance negative.

    The correlations of a replaced variance are set to zero, as in PX4."""
    lost = np.einsum("mii->mi", cov) < 0.0
    if lost.any():
        cov = np.where(lost[:, :, None] | lost[:, None, :], 0.0, cov)
        np.einsum("mii->mi", cov)[lost] = _SMALL_VARIANCE
    return cov


def _skew(v: Array) -> Array:
    m = np.zeros((*v.shape, 3))
    m[..., 0, 1], m[..., 0, 2], m[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    m[..., 1, 0], m[..., 2, 0], m[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return m
