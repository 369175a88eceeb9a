"""Covariance of the estimator's error state: prediction, correction, and repair of rounding errors.

Error state of 15 numbers, three each: position, velocity [NED], attitude [FRD], gyroscope bias, accelerometer bias.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels import limits
from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats

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
        cov, x = self.cov, self._column
        for k in range(15):
            for j in range(15):
                x[j] = cov[i, j, k]
            self._advance_error(i)
            for j in range(15):
                cov[i, j, k] = x[j]
        for k in range(15):
            for j in range(15):
                x[j] = cov[i, k, j]
            self._advance_error(i)
            for j in range(15):
                cov[i, k, j] = x[j]
        for k in range(15):
            grown = cov[i, k, k] + (self.growth[i, k - 3] if k >= 3 else 0.0)
            cov[i, k, k] = limits.within(grown, 0.0, _MOST_VARIANCE)
        for k in range(3):
            self.force_sum[i, k] = self.omega_sum[i, k] = 0.0

    def _advance_error(self, i: int) -> None:
        """Multiply the error state in `_column` by the state transition matrix F of vehicle i.

        F advances the error state by one prediction period.

        Derivatives: dp' = dv, dv' = -R (f x dth + dba), dth' = -w x dth - dbg, with specific force f, body rates w, and the
        errors of position dp, velocity dv, attitude dth, gyroscope bias dbg and accelerometer bias dba.
        """
        x, r, dt, period = self._column, self.r_nb, self.dt, self.dt * self.samples
        fx, fy, fz = self.force_sum[i, 0] * dt, self.force_sum[i, 1] * dt, self.force_sum[i, 2] * dt
        wx, wy, wz = self.omega_sum[i, 0] * dt, self.omega_sum[i, 1] * dt, self.omega_sum[i, 2] * dt
        tx, ty, tz = x[6], x[7], x[8]
        # Change of velocity in body axes
        ax = fy * tz - fz * ty + period * x[12]
        ay = fz * tx - fx * tz + period * x[13]
        az = fx * ty - fy * tx + period * x[14]
        for k in range(3):
            x[k] += period * x[3 + k]
            x[3 + k] -= r[i, k, 0] * ax + r[i, k, 1] * ay + r[i, k, 2] * az
        x[6] = tx - (wy * tz - wz * ty) - period * x[9]
        x[7] = ty - (wz * tx - wx * tz) - period * x[10]
        x[8] = tz - (wx * ty - wy * tx) - period * x[11]

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
