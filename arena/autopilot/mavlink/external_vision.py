"""Decodes the poses in ODOMETRY and VISION_POSITION_ESTIMATE messages (external vision).

A pose that PX4 would not fuse is ignored.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.estimation.estimator import VisionSample
from arena.geometry import quat_from_euler
from arena.wire.mavlink_records import Odometry, Triple

# PX4 accepts MAV_ESTIMATOR_TYPE_MOCAP, but its EKF2 never fuses it.
_FUSED = (
    mavlink.MAV_ESTIMATOR_TYPE_UNKNOWN,
    mavlink.MAV_ESTIMATOR_TYPE_VISION,
    mavlink.MAV_ESTIMATOR_TYPE_VIO,
)
_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD)
_DIAGONAL = (0, 6, 11, 15, 18, 20)  # of the row-major upper triangle
_MAX_DISTANCE_M = 1e4
_NO_ATTITUDE = (math.nan,) * 4


def from_odometry(m: Odometry) -> VisionSample | None:
    """Decode the pose in an ODOMETRY message.

    Return None if the message has no pose, or a pose that PX4 would not fuse.
    """
    if m.estimator_type not in _FUSED or m.frame_id not in _FRAMES:
        return None
    return _sample(m.p_n, m.q, m.variances)


def from_vision_estimate(m: Any) -> VisionSample | None:
    """Decode the pose in a VISION_POSITION_ESTIMATE message.

    Return None if the message has no pose.
    """
    rpy = (m.roll, m.pitch, m.yaw)
    if not all(math.isfinite(x) for x in rpy):
        return _sample((m.x, m.y, m.z), _NO_ATTITUDE, [m.covariance[k] for k in _DIAGONAL])
    return _sample(
        (m.x, m.y, m.z), tuple(quat_from_euler(rpy).tolist()), [m.covariance[k] for k in _DIAGONAL]
    )


def _sample(
    p: Triple, q: tuple[float, float, float, float], variances: Sequence[float]
) -> VisionSample | None:
    if not (abs(p[0]) < _MAX_DISTANCE_M and abs(p[1]) < _MAX_DISTANCE_M and abs(p[2]) < _MAX_DISTANCE_M):
        return None  # too far, or NaN
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    q = (w / norm, x / norm, y / norm, z / norm) if 0.9 < norm < 1.1 else _NO_ATTITUDE
    n, e, d, _, _, yaw = variances
    return VisionSample(p, q, (_variance(n), _variance(e), _variance(d)), _variance(yaw))


def _variance(given: float) -> float:
    """Return a variance from a message; 0 if the message gives none."""
    return given if 0.0 < given < math.inf else 0.0
