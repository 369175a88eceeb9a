"""Period at which the estimator predicts its covariance, as a number of IMU samples.

As in PX4's EKF2, the period is longer than that of the IMU. `arena.kernels.error_covariance` computes the prediction.
"""

from __future__ import annotations

import math

_PREDICT_S = 0.01  # EKF2_PREDICT_US of PX4 v1.16


def samples_per_prediction(dt: float) -> int:
    """Return how many IMU samples the estimator collects for one prediction of its covariance.

    dt: IMU period [s]

    PX4's `ImuDownSampler` rounds EKF2_PREDICT_US to a multiple of the IMU period: 8 ms at 250 Hz, 10 ms at 1000 Hz. PX4's
    estimate of the IMU period is slightly too large (32-bit floats), so a quotient such as 10 ms / 4 ms = 2.5 is rounded down.
    """
    return max(1, math.ceil(_PREDICT_S / dt - 0.5 - 1e-6))
