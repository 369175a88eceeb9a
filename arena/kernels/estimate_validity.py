"""Validity of the estimates of the built-in autopilots (position, height and heading).

`arena.autopilot.estimation.estimator` explains the conditions.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import limits
from arena.kernels.arrays import flags, floats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats
    from arena.kernels.strapdown import Strapdown
    from arena.kernels.vision_fusion import VisionFusion

    Mask = NDArray[np.bool_]

_USE_YAW = 8
"""Bit of EKF2_EV_CTRL."""
_ATTITUDE, _HORIZONTAL, _VERTICAL, _GLOBAL = 1.0, 266.0, 36.0, 16.0
"""ESTIMATOR_STATUS_FLAGS of a valid attitude, of a valid horizontal position and velocity (VELOCITY_HORIZ, POS_HORIZ_REL,
PRED_POS_HORIZ_REL), of a valid height (VELOCITY_VERT, POS_VERT_ABS), and of a valid global position (POS_HORIZ_ABS)."""


def status_flags(attitude: bool, horizontal: bool, vertical: bool, has_origin: bool) -> float:
    """Return the ESTIMATOR_STATUS_FLAGS of a vehicle.

    attitude, horizontal, vertical: whether attitude, horizontal position and height are valid
    has_origin: whether the origin of the local frame is set
    """
    found = _ATTITUDE if attitude else 0.0
    if horizontal:
        found += _HORIZONTAL
        if has_origin:
            found += _GLOBAL
    if vertical:
        found += _VERTICAL
    return found


class EstimateValidity:
    """Validity of the position, height and heading estimates of V vehicles.

    xy, z, yaw: output: whether horizontal position and velocity, height, and heading are valid (V,)
    rejected: output: whether the last pose was rejected (V,).  tilt: output: estimated tilt [rad] (V,)
    cov: covariance of the error state (V, 15, 15)
    limits: largest variances of valid position [m2], velocity [m2/s2] and attitude [rad2] (9,)
    settle_s: time from the alignment until the estimate is valid [s]
    timeout_s: EKF2_NOAID_TOUT [s] (V,)
    aligned_at, last_baro: time of the alignment, and of the last fusion of the barometer [s] (V,)
    """

    def __init__(
        self,
        state: Strapdown,
        vision: VisionFusion,
        cov: Floats,
        limits: Floats,
        settle_s: float,
        xy: Mask,
        z: Mask,
        yaw: Mask,
        rejected: Mask,
    ) -> None:
        v = len(xy)
        self.state, self.vision, self.cov, self.limits, self.settle_s = state, vision, cov, limits, settle_s
        self.xy, self.z, self.yaw, self.rejected = flags(xy), flags(z), flags(yaw), flags(rejected)
        self.tilt = floats(v)
        self.timeout_s, self.aligned_at = floats(v), floats(v, fill=float("inf"))
        self.last_baro = floats(v)

    def update(self, now: float) -> None:
        """Decide which estimates of each vehicle are valid.

        now: time since boot [s]
        """
        state, vision = self.state, self.vision
        for i in range(len(self.timeout_s)):
            timeout, aligned = self.timeout_s[i], state.aligned[i] != 0
            self.xy[i] = aligned and now - vision.last_xy[i] < timeout and self._has_converged(i, now)
            height = max(vision.last_z[i], self.last_baro[i])
            self.z[i] = aligned and now - height < timeout
            unused = vision.control[i] & _USE_YAW == 0
            self.yaw[i] = aligned and (unused or now - vision.last_yaw[i] < timeout)
            self.rejected[i] = vision.test_ratio[i, 0] > 1.0 or vision.test_ratio[i, 1] > 1.0
            self.tilt[i] = math.acos(limits.within(state.r_nb[i, 2, 2], -1.0, 1.0))

    def _has_converged(self, i: int, now: float) -> bool:
        """Return whether vehicle i has small variances, and was aligned more than `settle_s` ago."""
        for k in range(len(self.limits)):
            if not self.cov[i, k, k] < self.limits[k]:
                return False
        return now - self.aligned_at[i] > self.settle_s
