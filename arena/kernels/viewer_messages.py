"""Encoding of the messages for viewers: poses as Foxglove's Protobuf messages, and numbers as ROS 2 messages (CDR).

`arena.recorder.viewer_poses` describes the frames of the poses.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    Position = tuple[float, float, float]
    Quaternion = tuple[float, float, float, float]

_CDR_LITTLE_ENDIAN = 0x100  # the first four bytes of a message as a number
_NS_PER_S = 1_000_000_000
_MOST_BYTES = 128  # of a message without the names of its frames
_H = math.sqrt(0.5)
# First byte of each field of a Protobuf message: 8 * number of the field + type.
_TIME, _FRAME, _POSE = 0x0A, 0x12, 0x1A
_CHILD_FRAME, _TRANSLATION, _ROTATION = 0x1A, 0x22, 0x2A
_POSITION, _ORIENTATION = 0x0A, 0x12
_SECONDS, _NANOSECONDS, _FIRST_NUMBER = 0x08, 0x10, 0x09


def arena_position(p_n: Position) -> Position:
    """Convert a position from NED to the frame `arena`: (n, e, d) -> (e, n, -d).

    p_n: [m] [NED] (3,).
    """
    north, east, down = p_n
    return east, north, -down


def arena_attitude(q_nb: Quaternion) -> Quaternion:
    """Convert an attitude quaternion from FRD in NED to FLU in the frame `arena`.  wxyz (4,).

    It is `arena.geometry.q_wf_from_q_nb` written out for one vehicle in plain floats; a test compares both.
    """
    a, b, c, d = q_nb
    return _H * (a + d), _H * (b + c), _H * (b - c), _H * (a - d)


class NumberMessages:
    """Encoder of messages that consist of float32 numbers only.

    count: number of fields.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._payload = memoryview(bytearray(4 * (1 + count)))
        self._payload.cast("I")[0] = _CDR_LITTLE_ENDIAN
        self._f32 = self._payload.cast("f")

    def pack(self, values: Sequence[float]) -> bytes:
        """Return a message with the values of all its fields, in their order.

        Raises ValueError if the number of values is wrong.
        """
        if len(values) != self.count:
            raise ValueError(f"message for viewers: got {len(values)} values, expected {self.count}")
        for k in range(self.count):
            self.set(k, values[k])
        return self.message()

    def set(self, k: int, value: float) -> None:
        """Store the value of field k in the next message."""
        self._f32[1 + k] = value

    def message(self) -> bytes:
        """Return the message with the values that were stored last."""
        return self._payload.tobytes()


class PoseMessages:
    """Encoder of a pose as foxglove.PoseInFrame and as foxglove.FrameTransform.

    Store a pose with `set`, then read the messages. As in all Protobuf messages, numbers that are 0 are left out.

    root: name of the frame in which the poses are.  child: name of the body frame, for FrameTransform.
    """

    def __init__(self, root: str, child: str) -> None:
        self._root, self._child = _text_field(_FRAME, root), _text_field(_CHILD_FRAME, child)
        self._raw = memoryview(bytearray(len(self._root) + len(self._child) + _MOST_BYTES))
        self._u8 = self._raw
        self._begins: dict[int, memoryview] = {}
        number = memoryview(bytearray(8))
        self._number, self._bits = number.cast("d"), number.cast("Q")
        self._x = self._y = self._z = self._qw = self._qx = self._qy = self._qz = 0.0
        self._log_time = 0

    def set(self, p_n: Position, q_nb: Quaternion, log_time: int) -> None:
        """Store a pose for the next messages.

        p_n: position of the body origin [m] [NED] (3,).  q_nb: attitude [-] wxyz (4,).  log_time: log time [ns].
        """
        self._x, self._y, self._z = arena_position(p_n)
        self._qw, self._qx, self._qy, self._qz = arena_attitude(q_nb)
        self._log_time = log_time

    def pose(self) -> bytes:
        """Return the pose as a message foxglove.PoseInFrame."""
        u8 = self._u8
        begin = self._put_head(u8) + 2
        at = self._put_position(u8, begin, _POSITION)
        at = self._put_attitude(u8, at, _ORIENTATION)
        u8[begin - 2], u8[begin - 1] = _POSE, at - begin
        return self._first_bytes(at)

    def transform(self) -> bytes:
        """Return the pose as a message foxglove.FrameTransform, from the root frame to the body frame."""
        u8 = self._u8
        at = _put(u8, self._put_head(u8), self._child)
        at = self._put_position(u8, at, _TRANSLATION)
        at = self._put_attitude(u8, at, _ROTATION)
        return self._first_bytes(at)

    def _first_bytes(self, size: int) -> bytes:
        """Return the first bytes of the buffer. Views of it are kept, because making one takes longer than the copy."""
        view = self._begins.get(size)
        if view is None:
            view = self._begins[size] = self._raw[:size]
        return view.tobytes()

    def _put_head(self, u8: memoryview) -> int:
        """Write the log time and the root frame, with which both messages begin. Return the position after them."""
        at = _put_integer(u8, 2, _SECONDS, self._log_time // _NS_PER_S)
        at = _put_integer(u8, at, _NANOSECONDS, self._log_time % _NS_PER_S)
        u8[0], u8[1] = _TIME, at - 2
        return _put(u8, at, self._root)

    def _put_position(self, u8: memoryview, at: int, field: int) -> int:
        end = self._put_number(u8, at + 2, _FIRST_NUMBER, self._x)
        end = self._put_number(u8, end, _FIRST_NUMBER + 8, self._y)
        end = self._put_number(u8, end, _FIRST_NUMBER + 16, self._z)
        u8[at], u8[at + 1] = field, end - at - 2
        return end

    def _put_attitude(self, u8: memoryview, at: int, field: int) -> int:
        end = self._put_number(u8, at + 2, _FIRST_NUMBER, self._qx)
        end = self._put_number(u8, end, _FIRST_NUMBER + 8, self._qy)
        end = self._put_number(u8, end, _FIRST_NUMBER + 16, self._qz)
        end = self._put_number(u8, end, _FIRST_NUMBER + 24, self._qw)
        u8[at], u8[at + 1] = field, end - at - 2
        return end

    def _put_number(self, u8: memoryview, at: int, field: int, value: float) -> int:
        """Write a field that is a float64, or nothing if it is 0. Return the position after it."""
        if value == 0.0:
            return at
        self._number[0] = value
        bits = self._bits[0]
        u8[at] = field
        for k in range(8):
            u8[at + 1 + k] = bits >> 8 * k & 0xFF
        return at + 9


def _put_integer(u8: memoryview, at: int, field: int, value: int) -> int:
    """Write a field that is a non-negative integer of variable length, or nothing if it is 0. Return the position after it."""
    if value == 0:
        return at
    u8[at] = field
    at += 1
    while value > 127:
        u8[at] = 128 | value & 127
        value >>= 7
        at += 1
    u8[at] = value
    return at + 1


def _put(u8: memoryview, at: int, data: bytes) -> int:
    """Copy bytes into a buffer. Return the position after them."""
    size = len(data)
    for k in range(size):
        u8[at + k] = data[k]
    return at + size


def _text_field(field: int, text: str) -> bytes:
    """Return a field of a Protobuf message that is a text: its first byte, the number of bytes, the bytes."""
    data = text.encode()
    size, head = len(data), bytearray((field,))
    while size > 127:
        head.append(128 + size % 128)
        size //= 128
    head.append(size)
    return bytes(head) + data if data else b""
