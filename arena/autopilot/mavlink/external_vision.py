"""External vision off the wire: what PX4 takes for visual odometry, and what it does not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import quat_from_euler
from arena.wire.mavlink_records import Odometry, Triple

# MOCAP is accepted on the wire and never fused by PX4's EKF2; so here.
_FUSED = (
    mavlink.MAV_ESTIMATOR_TYPE_UNKNOWN,
    mavlink.MAV_ESTIMATOR_TYPE_VISION,
    mavlink.MAV_ESTIMATOR_TYPE_VIO,
)
_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD)
_DIAGONAL = (0, 6, 11, 15, 18, 20)  # of the row-major upper triangle
_FAR_M = 1e4
_NONE = (math.nan,) * 4


@dataclass(frozen=True, slots=True)
class Vision:
    """p_n [m] [NED], q_nb wxyz (NaN when not given), variances [m2] (3,) and of yaw [rad2]; 0 where the sender does not know."""

    p_n: Triple
    q_nb: tuple[float, float, float, float]
    var_p: Triple
    var_yaw: float


def from_odometry(m: Odometry) -> Vision | None:
    """ODOMETRY -> a sample, or None for one that PX4 would not fuse or that is no pose."""
    if m.estimator_type not in _FUSED or m.frame_id not in _FRAMES:
        return None
    return _vision(m.p_n, m.q, m.variances)


def from_vision_estimate(m: Any) -> Vision | None:
    """VISION_POSITION_ESTIMATE -> a sample, or None."""
    rpy = (m.roll, m.pitch, m.yaw)
    if not all(math.isfinite(x) for x in rpy):
        return _vision((m.x, m.y, m.z), _NONE, [m.covariance[k] for k in _DIAGONAL])
    return _vision(
        (m.x, m.y, m.z), tuple(quat_from_euler(rpy).tolist()), [m.covariance[k] for k in _DIAGONAL]
    )


def _vision(p: Triple, q: tuple[float, float, float, float], variances: Sequence[float]) -> Vision | None:
    if not (
        abs(p[0]) < _FAR_M and abs(p[1]) < _FAR_M and abs(p[2]) < _FAR_M
    ):  # what is no number is not near
        return None
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    q = (w / norm, x / norm, y / norm, z / norm) if 0.9 < norm < 1.1 else _NONE
    n, e, d, _, _, yaw = (x if 0.0 < x < math.inf else 0.0 for x in variances)
    return Vision(p, q, (n, e, d), yaw)
