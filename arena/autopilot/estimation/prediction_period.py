"""Period at which the estimator predicts the covariance of its error state. As in PX4's EKF2, the period is longer than that
of the IMU. `arena.kernels.error_covariance` computes the prediction.
"""

from __future__ import annotations

import math

_PREDICT_S = 0.01  # EKF2_PREDICT_US of PX4 v1.16


def samples_per_prediction(dt: float) -> int:
    """Return after how many IMU samples the estimator predicts the covariance. dt: IMU period [s].

    PX4 rounds EKF2_PREDICT_US to a multiple of the IMU period. PX4's estimate of the IMU period is slightly too large, so
    a half is rounded down (`ImuDownSampler`, computed in 32-bit floats): 8 ms at 250 Hz, 10 ms at 1000 Hz.
    """
    return max(1, math.ceil(_PREDICT_S / dt - 0.5 - 1e-6))
