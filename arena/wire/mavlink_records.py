"""Fast decoders of the setpoints and poses that an autopilot receives, and a packer of poses.

They are faster than pymavlink's objects. Tests compare them with pymavlink.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import nan
from typing import Any, NamedTuple, Self

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import Buffer, Frame

Triple = tuple[float, float, float]

SET_POSITION_TARGET, ODOMETRY = 84, 331


class Odometry(NamedTuple):
    """Content of an ODOMETRY message: position, attitude and their variances.

    p_n [m] in `frame_id`, q wxyz, variances of x, y, z, roll, pitch, yaw.
    """

    p_n: Triple
    q: tuple[float, float, float, float]
    variances: tuple[float, ...]
    frame_id: int
    estimator_type: int

    @classmethod
    def read(cls, data: Buffer, at: Frame) -> Self:
        v = _unpacked(_ODOMETRY, data, at)
        found: Self = _new(cls, (v[:3], v[3:7], v[7:13], v[13], v[14]))
        return found


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


class PositionTarget(NamedTuple):
    """Contents of a SET_POSITION_TARGET_LOCAL_NED message, in the order of the message's fields."""

    time_boot_ms: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    afx: float
    afy: float
    afz: float
    yaw: float
    yaw_rate: float
    type_mask: int
    target_system: int
    target_component: int
    coordinate_frame: int

    @classmethod
    def read(cls, data: Buffer, at: Frame) -> Self:
        found: Self = _new(cls, _unpacked(_POSITION_TARGET, data, at))
        return found


_new: Any = tuple.__new__
_TIME_AND_POSE, _VELOCITY_AND_COVARIANCES = struct.Struct("<Q7f"), struct.Struct("<48fBB")
_FULL_QUALITY = 100
# Without the time, the velocities and the off-diagonal elements of the pose covariance.
_ODOMETRY = struct.Struct("<8x 7f 24x f20x f16x f12x f8x f4x f 84x BxxBx")
_POSITION_TARGET = struct.Struct("<I11fHBBB")


def _unpacked(layout: struct.Struct, data: Buffer, at: Frame) -> tuple[Any, ...]:
    """Return the values of a payload. Bytes that MAVLink 2 has truncated count as 0."""
    if at.size >= layout.size:
        return layout.unpack_from(data, at.payload)
    return layout.unpack(bytes(data[at.payload : at.payload + at.size]).ljust(layout.size, b"\0"))
