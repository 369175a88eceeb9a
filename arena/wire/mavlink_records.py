"""Fast packer of the poses that an autopilot receives. Tests compare it with pymavlink, whose objects are slower."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import nan

from pymavlink.dialects.v20 import common as mavlink

from arena.kernels.odometry_frames import OdometryFrames
from arena.wire.mavlink_frame import SEEDS

_ODOMETRY = mavlink.MAVLINK_MSG_ID_ODOMETRY
_PAYLOAD = struct.Struct("<Q55f5B")
_FULL_QUALITY = 100


def odometry_frames(covariance: Sequence[float], system: int, component: int) -> OdometryFrames:
    """Return a packer of ODOMETRY messages that contain captured poses of one vehicle (NED, FRD), without velocities.

    covariance: of the pose, upper triangle (21,).  system, component: MAVLink ids of the sender.
    """
    pose, velocity, velocity_covariance = (0.0,) * 7, (nan,) * 6, (nan,) * 21
    frames = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD
    payload = _PAYLOAD.pack(
        *(0, *pose, *velocity, *covariance, *velocity_covariance),
        *(*frames, 0, mavlink.MAV_ESTIMATOR_TYPE_VISION, _FULL_QUALITY),
    )
    return OdometryFrames(payload, _ODOMETRY, SEEDS[_ODOMETRY], system, component)
