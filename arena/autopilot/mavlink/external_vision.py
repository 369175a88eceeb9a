"""Decodes the poses in VISION_POSITION_ESTIMATE messages (external vision).

The kernel `ordinary_messages` decodes the frequent message ODOMETRY.
"""

from __future__ import annotations

import math
from typing import Any

from arena.geometry import quat_from_euler
from arena.kernels.vision_input import VisionInput

_NORTH, _EAST, _DOWN, _YAW = 0, 6, 11, 20  # diagonal elements of the row-major upper triangle
_NO_ATTITUDE = (math.nan,) * 4


def receive_vision_estimate(m: Any, vision: VisionInput, row: int) -> None:
    """Pass the pose in a VISION_POSITION_ESTIMATE message on.

    vision: receives it. row: row of the vehicle in the arrays over all vehicles
    """
    rpy = (m.roll, m.pitch, m.yaw)
    q_nb = tuple(quat_from_euler(rpy).tolist()) if all(math.isfinite(x) for x in rpy) else _NO_ATTITUDE
    var = m.covariance
    vision.receive(row, (m.x, m.y, m.z), q_nb, (var[_NORTH], var[_EAST], var[_DOWN]), var[_YAW])
