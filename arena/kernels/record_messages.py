"""Encoding of motion capture frames and true states for the record of a flight.

`arena.wire.flight_record` contains the schemas of the messages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    Triple = tuple[float, float, float]
    Quad = tuple[float, float, float, float]

_CDR_LITTLE_ENDIAN = 0x100  # the first four bytes of a message as a number
# Positions in a buffer in which all float64 are aligned: the message begins at byte 4.
_HEAD, _DATA = 4, 8
_NUMBER, _SIMULATED, _EXPOSED, _SENT, _COUNT, _BODIES = 8, 12, 16, 24, 32, 36
_POSE_BYTES = 56
_NAN = float("nan")


class FrameMessages:
    """Encoder of motion capture frames with the same rigid bodies.

    names: of the bodies: first those that are tracked, then the others.
    tracked: number of tracked bodies.
    """

    def __init__(self, names: Sequence[str], tracked: int) -> None:
        at, encoded = _BODIES, [name.encode() + b"\0" for name in names]
        places, order = [0] * len(names), sorted(range(len(names)), key=lambda k: names[k])
        for k in order:
            places[k] = _after(_after(at, 4) + 4 + len(encoded[k]) + 1, 8)
            at = places[k] + _POSE_BYTES
        raw = memoryview(bytearray(_after(at, 8)))
        self._message, self._count = raw[_HEAD:at], tracked
        self._u8, self._u32, self._f64 = raw, raw.cast("I"), raw.cast("d")
        self._places = memoryview(bytearray(8 * max(1, len(names)))).cast("l")
        self._u32[_HEAD // 4], self._u32[_COUNT // 4] = _CDR_LITTLE_ENDIAN, len(names)
        begin = _BODIES
        for k in order:
            self._places[k] = places[k] // 8
            begin = _after(begin, 4)
            self._u32[begin // 4] = len(encoded[k])
            flag = begin + 4 + len(encoded[k])
            raw[begin + 4 : flag] = encoded[k]
            raw[flag] = k < tracked
            if k >= tracked:
                for place in range(places[k] // 8, places[k] // 8 + 7):
                    self._f64[place] = _NAN
            begin = places[k] + _POSE_BYTES

    def pack(
        self, number: int, exposed_s: float, sent_s: float, simulated: bool, poses: Sequence[Any]
    ) -> bytes:
        """Return the message of a frame.

        number, exposed_s, sent_s, simulated: fields of the schema `CAPTURED_FRAME`.
        poses: (name, p_n, q_nb) of each tracked body, in the order of `names`.
        """
        self._u32[_NUMBER // 4], self._u8[_SIMULATED] = number & 0xFFFFFFFF, simulated
        self._f64[_EXPOSED // 8], self._f64[_SENT // 8] = exposed_s, sent_s
        for k in range(self._count):
            pose = poses[k]
            self._put(self._places[k], pose[1], pose[2])
        return self._message.tobytes()

    def _put(self, at: int, p_n: Triple, q_nb: Quad) -> None:
        f64 = self._f64
        f64[at], f64[at + 1], f64[at + 2] = p_n
        f64[at + 3], f64[at + 4], f64[at + 5], f64[at + 6] = q_nb


class StateMessages:
    """Encoder of the true states of simulated vehicles."""

    def __init__(self) -> None:
        raw = memoryview(bytearray(_DATA + 13 * 8))
        raw.cast("I")[_HEAD // 4] = _CDR_LITTLE_ENDIAN
        self._message, self._f64 = raw[_HEAD:], raw.cast("d")

    def pack(self, p_n: Triple, v_n: Triple, q_nb: Quad, omega_b: Triple) -> bytes:
        """Return the message of one vehicle. The arguments are the fields of the schema `TRUE_STATE`."""
        f64 = self._f64
        f64[1], f64[2], f64[3] = p_n
        f64[4], f64[5], f64[6] = v_n
        f64[7], f64[8], f64[9], f64[10] = q_nb
        f64[11], f64[12], f64[13] = omega_b
        return self._message.tobytes()


def _after(at: int, size: int) -> int:
    """Return the first position from `at` on that is a multiple of a size."""
    return -(-at // size) * size
