"""Covariance of the estimator's error state: prediction, correction, and repair of rounding errors.

Error state of 15 numbers, three each: position, velocity [NED], attitude [FRD], gyroscope bias, accelerometer bias.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels import limits
from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats

    Triple = tuple[float, float, float]
    Nine = tuple[float, float, float, float, float, float, float, float, float]

_SMALL_VARIANCE = 1e-6
_MOST_VARIANCE = 1e4


class ErrorCovariance:
    """Covariance matrices of the estimator's error state, for V vehicles.

    dt: IMU period [s]
    samples: number of IMU samples of a prediction; each prediction uses their mean, as PX4's `ImuDownSampler`
    growth: variances that each prediction adds to velocity, attitude and both biases (V, 12)
    r_nb, force_b, omega_b: input: rotation matrix (V, 3, 3), specific force [m/s2] and body rates [rad/s] without bias
        [FRD] (V, 3)
    cov: covariance (V, 15, 15)
    error: estimated error of the vehicle that is corrected (15,)
    """

    def __init__(self, dt: float, samples: int, r_nb: Floats, force_b: Floats, omega_b: Floats) -> None:
        v, self.dt, self.samples, self.summed = len(force_b), dt, samples, 0
        self.r_nb, self.force_b, self.omega_b = r_nb, force_b, omega_b
        self.growth, self.cov = floats(v, 12), floats(v, 15, 15)
        self.force_sum, self.omega_sum = floats(v, 3), floats(v, 3)
        self.error, self._column = floats(15), floats(15)

    def step(self) -> None:
        """Add one IMU sample, and predict all covariances if the prediction period is complete."""
        self.summed += 1
        for i in range(len(self.force_sum)):
            for k in range(3):
                self.force_sum[i, k] += self.force_b[i, k]
                self.omega_sum[i, k] += self.omega_b[i, k]
            if self.summed == self.samples:
                self._predict(i)
        if self.summed == self.samples:
            self.summed = 0

    def _predict(self, i: int) -> None:
        """Predict the covariance P of vehicle i: replace P by F P F^T + Q.

        F: matrix that advances the error state by one prediction period
        Q: diagonal matrix of the variances `growth`
        """
        cov = self.cov
        self._set_transition(i)
        for k in range(15):  # columns: F P
            (
                cov[i, 0, k],
                cov[i, 1, k],
                cov[i, 2, k],
                cov[i, 3, k],
                cov[i, 4, k],
                cov[i, 5, k],
                cov[i, 6, k],
                cov[i, 7, k],
                cov[i, 8, k],
            ) = self._advanced(
                (cov[i, 0, k], cov[i, 1, k], cov[i, 2, k]),
                (cov[i, 3, k], cov[i, 4, k], cov[i, 5, k]),
                (cov[i, 6, k], cov[i, 7, k], cov[i, 8, k]),
                (cov[i, 9, k], cov[i, 10, k], cov[i, 11, k]),
                (cov[i, 12, k], cov[i, 13, k], cov[i, 14, k]),
            )
        for k in range(15):  # rows: (F P) F^T
            (
                cov[i, k, 0],
                cov[i, k, 1],
                cov[i, k, 2],
                cov[i, k, 3],
                cov[i, k, 4],
                cov[i, k, 5],
                cov[i, k, 6],
                cov[i, k, 7],
                cov[i, k, 8],
            ) = self._advanced(
                (cov[i, k, 0], cov[i, k, 1], cov[i, k, 2]),
                (cov[i, k, 3], cov[i, k, 4], cov[i, k, 5]),
                (cov[i, k, 6], cov[i, k, 7], cov[i, k, 8]),
                (cov[i, k, 9], cov[i, k, 10], cov[i, k, 11]),
                (cov[i, k, 12], cov[i, k, 13], cov[i, k, 14]),
            )
        for k in range(15):
            grown = cov[i, k, k] + (self.growth[i, k - 3] if k >= 3 else 0.0)
            cov[i, k, k] = limits.within(grown, 0.0, _MOST_VARIANCE)
        for k in range(3):
            self.force_sum[i, k] = self.omega_sum[i, k] = 0.0

    def _set_transition(self, i: int) -> None:
        """Set the values of the state transition matrix F of vehicle i, which `_advanced` uses."""
        r, force, omega, dt = self.r_nb, self.force_sum, self.omega_sum, self.dt
        self._fx, self._fy, self._fz = force[i, 0] * dt, force[i, 1] * dt, force[i, 2] * dt
        self._wx, self._wy, self._wz = omega[i, 0] * dt, omega[i, 1] * dt, omega[i, 2] * dt
        self._period = dt * self.samples
        self._r00, self._r01, self._r02 = r[i, 0, 0], r[i, 0, 1], r[i, 0, 2]
        self._r10, self._r11, self._r12 = r[i, 1, 0], r[i, 1, 1], r[i, 1, 2]
        self._r20, self._r21, self._r22 = r[i, 2, 0], r[i, 2, 1], r[i, 2, 2]

    def _advanced(self, p: Triple, v: Triple, th: Triple, bg: Triple, ba: Triple) -> Nine:
        """Multiply an error state by the state transition matrix F. Return the new errors dp, dv and dth; dbg and dba stay.

        F advances the error state by one prediction period.

        Derivatives: dp' = dv, dv' = -R (f x dth + dba), dth' = -w x dth - dbg, with specific force f, body rates w, and the
        errors of position dp, velocity dv, attitude dth, gyroscope bias dbg and accelerometer bias dba.
        """
        period, tx, ty, tz = self._period, th[0], th[1], th[2]
        # Change of velocity in body axes
        ax = self._fy * tz - self._fz * ty + period * ba[0]
        ay = self._fz * tx - self._fx * tz + period * ba[1]
        az = self._fx * ty - self._fy * tx + period * ba[2]
        return (
            p[0] + period * v[0],
            p[1] + period * v[1],
            p[2] + period * v[2],
            v[0] - (self._r00 * ax + self._r01 * ay + self._r02 * az),
            v[1] - (self._r10 * ax + self._r11 * ay + self._r12 * az),
            v[2] - (self._r20 * ax + self._r21 * ay + self._r22 * az),
            tx - (self._wy * tz - self._wz * ty) - period * bg[0],
            ty - (self._wz * tx - self._wx * tz) - period * bg[1],
            tz - (self._wx * ty - self._wy * tx) - period * bg[2],
        )

    def variance(self, i: int, jacobian: Floats, row: int) -> float:
        """Return the predicted variance of a measurement, without the noise of the measurement itself.

        jacobian: derivatives of measurements by the error state (M, 15)
        row: row of the measurement
        """
        total = 0.0
        for j in range(15):
            if jacobian[row, j] != 0.0:
                for k in range(15):
                    total += jacobian[row, j] * self.cov[i, j, k] * jacobian[row, k]
        return total

    def begin(self) -> None:
        """Reset the estimated error to zero, before measurements of another vehicle are fused."""
        for k in range(15):
            self.error[k] = 0.0

    def correct(self, i: int, jacobian: Floats, row: int, innovation: float, noise: float) -> None:
        """Fuse one scalar measurement of vehicle i: update the estimated error and the covariance.

        Measurements with independent noise may be used one after the other; the result is that of all at once.

        jacobian: derivatives of measurements by the error state (M, 15)
        row: row of the measurement
        innovation: measured minus predicted value
        noise: variance of the measurement's noise
        """
        cov, covariance = self.cov, self._column  # covariance of error state and measurement
        variance, left = noise, innovation
        for j in range(15):
            covariance[j] = 0.0
        for k in range(15):
            if jacobian[row, k] != 0.0:
                for j in range(15):
                    covariance[j] += cov[i, j, k] * jacobian[row, k]
        for k in range(15):
            variance += jacobian[row, k] * covariance[k]
            left -= jacobian[row, k] * self.error[k]
        for j in range(15):
            gain = covariance[j] / variance
            self.error[j] += gain * left
            for k in range(15):
                cov[i, j, k] -= gain * covariance[k]

    def repair(self, i: int) -> None:
        """Make the covariance of vehicle i symmetric, and its variances positive.

        Rounding errors can make a variance negative. Its correlations are set to zero, as in PX4.
        """
        cov = self.cov
        for j in range(15):
            for k in range(j):
                cov[i, j, k] = cov[i, k, j] = 0.5 * (cov[i, j, k] + cov[i, k, j])
        for j in range(15):
            if cov[i, j, j] < 0.0:
                for k in range(15):
                    cov[i, j, k] = cov[i, k, j] = 0.0
                cov[i, j, j] = _SMALL_VARIANCE
