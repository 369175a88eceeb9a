"""External vision off the wire: what PX4 takes for visual odometry, and what it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import quat_from_euler

# MOCAP is accepted on the wire and never fused by PX4's EKF2; so here.
_FUSED = (mavlink.MAV_ESTIMATOR_TYPE_UNKNOWN, mavlink.MAV_ESTIMATOR_TYPE_VISION, mavlink.MAV_ESTIMATOR_TYPE_VIO)
_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD)
_DIAGONAL = (0, 6, 11, 15, 18, 20)  # of the row-major upper triangle
_FAR_M = 1e4


@dataclass(frozen=True, slots=True)
class Vision:
    """p_n [m] [NED], q_nb wxyz (NaN when not given), variances [m2] (3,) and of yaw [rad2]; 0 where the sender does not know."""

    p_n: tuple[float, float, float]
    q_nb: tuple[float, float, float, float]
    var_p: tuple[float, float, float]
    var_yaw: float


def from_odometry(m: Any) -> Vision | None:
    """ODOMETRY -> a sample, or None for one that PX4 would not fuse or that is no pose."""
    if m.estimator_type not in _FUSED or m.frame_id not in _FRAMES:
        return None
    variances = [m.pose_covariance[k] for k in _DIAGONAL]
    return _vision((m.x, m.y, m.z), tuple(m.q), variances)


def from_vision_estimate(m: Any) -> Vision | None:
    """VISION_POSITION_ESTIMATE -> a sample, or None."""
    rpy = (m.roll, m.pitch, m.yaw)
    if not all(math.isfinite(x) for x in rpy):
        return _vision((m.x, m.y, m.z), (math.nan,) * 4, [m.covariance[k] for k in _DIAGONAL])
    return _vision((m.x, m.y, m.z), tuple(quat_from_euler(rpy).tolist()), [m.covariance[k] for k in _DIAGONAL])


def _vision(p: tuple[float, ...], q: tuple[float, ...], variances: list[float]) -> Vision | None:
    if not all(math.isfinite(x) and abs(x) < _FAR_M for x in p):
        return None
    norm = math.sqrt(sum(x * x for x in q))
    q = tuple(x / norm for x in q) if math.isfinite(norm) and 0.9 < norm < 1.1 else (math.nan,) * 4
    known = [x if math.isfinite(x) and x > 0 else 0.0 for x in variances]
    return Vision((p[0], p[1], p[2]), (q[0], q[1], q[2], q[3]), (known[0], known[1], known[2]), known[5])
