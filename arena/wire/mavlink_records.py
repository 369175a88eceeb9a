"""Messages that an autopilot sends and receives many times a second, as plain records, which are faster than
pymavlink's objects.

Sent messages: one numpy record per vehicle, in wire order; `payloads` splits the records of all vehicles.
Values that belong together are one field: `p_n` is x, y, z. Received messages: `Odometry` and
`PositionTarget`, with only the fields that are used. Tests compare both directions with pymavlink.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from arena.wire.mavlink_frame import Buffer, Frame

Records = NDArray[np.void]
Triple = tuple[float, float, float]

HEARTBEAT, SYS_STATUS, SYSTEM_TIME = 0, 1, 2
ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, GLOBAL_POSITION_INT, SERVO_OUTPUT_RAW = 30, 31, 32, 33, 36
VFR_HUD, ATTITUDE_TARGET, SET_POSITION_TARGET, POSITION_TARGET, HIGHRES_IMU, TIMESYNC, ALTITUDE = (
    74,
    83,
    84,
    85,
    105,
    111,
    141,
)
EXTENDED_SYS_STATE, ODOMETRY = 245, 331

_U8, _I8, _U16, _I16, _U32, _I32, _U64, _I64, _F32 = (
    "u1",
    "i1",
    "<u2",
    "<i2",
    "<u4",
    "<i4",
    "<u8",
    "<i8",
    "<f4",
)
_BOOT_MS, _TIME_US = ("time_boot_ms", _U32), ("time_usec", _U64)
_P, _V, _A, _OMEGA, _Q = (
    ("p_n", _F32, 3),
    ("v_n", _F32, 3),
    ("a_n", _F32, 3),
    ("omega_b", _F32, 3),
    ("q_nb", _F32, 4),
)

LAYOUTS: dict[int, Any] = {
    HEARTBEAT: [
        ("custom_mode", _U32),
        ("type", _U8),
        ("autopilot", _U8),
        ("base_mode", _U8),
        ("status", _U8),
        ("version", _U8),
    ],
    SYS_STATUS: [
        ("present", _U32),
        ("enabled", _U32),
        ("health", _U32),
        ("load", _U16),
        ("voltage", _U16),
        ("current", _I16),
        ("errors", _U16, 6),
        ("remaining", _I8),
        ("extended", _U32, 3),
    ],
    SYSTEM_TIME: [("time_unix_usec", _U64), _BOOT_MS],
    ATTITUDE: [_BOOT_MS, ("rpy", _F32, 3), _OMEGA],
    ATTITUDE_QUATERNION: [_BOOT_MS, _Q, _OMEGA, ("offset_q", _F32, 4)],
    LOCAL_POSITION_NED: [_BOOT_MS, _P, _V],
    GLOBAL_POSITION_INT: [
        _BOOT_MS,
        ("lat", _I32),
        ("lon", _I32),
        ("alt", _I32),
        ("relative_alt", _I32),
        ("v_n", _I16, 3),
        ("heading", _U16),
    ],
    SERVO_OUTPUT_RAW: [("time_usec", _U32), ("servos", _U16, 8), ("port", _U8), ("more", _U16, 8)],
    VFR_HUD: [
        ("airspeed", _F32),
        ("groundspeed", _F32),
        ("alt", _F32),
        ("climb", _F32),
        ("heading", _I16),
        ("throttle", _U16),
    ],
    ATTITUDE_TARGET: [_BOOT_MS, _Q, _OMEGA, ("thrust", _F32), ("mask", _U8)],
    POSITION_TARGET: [_BOOT_MS, ("values", _F32, 11), ("mask", _U16), ("frame", _U8)],
    HIGHRES_IMU: [
        _TIME_US,
        ("accel_b", _F32, 3),
        ("gyro_b", _F32, 3),
        ("mag_b", _F32, 3),
        ("pressure", _F32),
        ("difference", _F32),
        ("altitude", _F32),
        ("temperature", _F32),
        ("updated", _U16),
        ("id", _U8),
    ],
    TIMESYNC: [("tc1", _I64), ("ts1", _I64)],
    ALTITUDE: [_TIME_US, ("heights", _F32, 6)],
    EXTENDED_SYS_STATE: [("vtol", _U8), ("landed", _U8)],
    ODOMETRY: [
        _TIME_US,
        _P,
        _Q,
        _V,
        _OMEGA,
        ("pose_variance", _F32, 21),
        ("velocity_variance", _F32, 21),
        ("frame", _U8),
        ("child", _U8),
        ("reset_counter", _U8),
        ("estimator", _U8),
        ("quality", _I8),
    ],
}


def record(msgid: int, **constants: Any) -> Records:
    """Return a numpy record (1,) for a message of this id. The fields in `constants` have the given values, the others are zero."""
    blank = np.zeros(1, np.dtype(LAYOUTS[msgid]))
    for name, value in constants.items():
        blank[name] = value
    return blank


def payloads(records: Records) -> list[bytes]:
    """Convert the records of one message type, one record per vehicle, to the payloads to send."""
    data, size = records.tobytes(), records.itemsize
    return [data[at : at + size] for at in range(0, len(data), size)]


class Odometry(NamedTuple):
    """Contents of an ODOMETRY message: p_n [m] in `frame_id`, q wxyz, variances of x, y, z, roll, pitch, yaw."""

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
# Without the time, the velocities and the off-diagonal elements of the pose covariance.
_ODOMETRY = struct.Struct("<8x 7f 24x f20x f16x f12x f8x f4x f 84x BxxBx")
_POSITION_TARGET = struct.Struct("<I11fHBBB")


def _unpacked(layout: struct.Struct, data: Buffer, at: Frame) -> tuple[Any, ...]:
    """Return the values of a payload; bytes that MAVLink 2 has truncated count as 0."""
    if at.size >= layout.size:
        return layout.unpack_from(data, at.payload)
    return layout.unpack(bytes(data[at.payload : at.payload + at.size]).ljust(layout.size, b"\0"))
