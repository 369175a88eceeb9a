"""Fast packer of the poses that an autopilot receives. Tests compare it with pymavlink, whose objects are slower."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import nan

from pymavlink.dialects.v20 import common as mavlink

Triple = tuple[float, float, float]

ODOMETRY = 331


class OdometryPacker:
    """Packer of ODOMETRY payloads that contain captured poses of one vehicle (NED, FRD), without velocities.

    covariance: of the pose, upper triangle (21,).
    """

    def __init__(self, covariance: Sequence[float]) -> None:
        unknown = (nan,) * 21
        self._unchanging = _VELOCITY_AND_COVARIANCES.pack(
            *unknown[:6],
            *covariance,
            *unknown,
            mavlink.MAV_FRAME_LOCAL_NED,
            mavlink.MAV_FRAME_BODY_FRD,
        )

    def payload(self, time_us: int, p_n: Triple, q_nb: Sequence[float], reset_counter: int) -> bytes:
        """Return the payload of an ODOMETRY message.

        p_n: position [m] [NED] (3,). q_nb: attitude [-] wxyz (4,). reset_counter: 0..255
        """
        end = bytes((reset_counter, mavlink.MAV_ESTIMATOR_TYPE_VISION, _FULL_QUALITY))
        return _TIME_AND_POSE.pack(time_us, *p_n, *q_nb) + self._unchanging + end


_TIME_AND_POSE, _VELOCITY_AND_COVARIANCES = struct.Struct("<Q7f"), struct.Struct("<48fBB")
_FULL_QUALITY = 100
