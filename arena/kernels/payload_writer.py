"""Frames of one MAVLink message type, written in place: numbers become fields of the payload, then header and CRC follow."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import limits, mavlink_framing

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats, Integers

KINDS = "BbHhIiQqf"
"""Types of fields that can be packed, as codes of the module `struct`. The tables contain positions in this text."""
_MOST_BYTES = 264  # more than every payload and CRC
HEAD, _PAYLOAD = 6, 16
"""Offset of a frame in the buffer of its writer, and of the payload, which is aligned to 8 bytes."""
_UINT8, _INT8, _UINT16, _INT16, _UINT32, _INT32, _UINT64, _INT64, _FLOAT32 = range(9)  # positions in KINDS


class PayloadWriter:
    """Writer of the frames of one MAVLink message type, always into the same buffer.

    frame: the buffer. end: offset of the CRC of the newest frame
    number, seed: message id and its seed byte CRC_EXTRA
    fields: for each number in the payload: its position in the values, its type as position in `KINDS`, and its offset in
        units of the type's size (F, 3). The other bytes of the payload are 0
    ranges: smallest and largest value of each type in `KINDS` (9, 2)
    needs: set of the groups of quantities that the payload contains, one bit each (`telemetry_quantities.BITS`)
    """

    def __init__(
        self,
        number: int,
        size: int,
        seed: bytes,
        fields: Integers,
        ranges: Floats,
        needs: int,
    ) -> None:
        """Create the writer for one message type, with a buffer for the payload.

        size: number of bytes of the payload
        """
        self.number, self.seed, self.fields, self.ranges = number, seed, fields, ranges
        self.needs, self.size, self.end = needs, size, _PAYLOAD
        whole = memoryview(bytearray(_PAYLOAD + _MOST_BYTES))
        self.frame, raw = whole, whole[_PAYLOAD:]
        self.u8, self.i8 = raw, raw.cast("b")
        self.u16, self.i16, self.u32, self.i32 = raw.cast("H"), raw.cast("h"), raw.cast("I"), raw.cast("i")
        self.u64, self.i64, self.f32 = raw.cast("Q"), raw.cast("q"), raw.cast("f")

    def write(self, values: Floats, seq: int, sysid: int, compid: int) -> int:
        """Encode the values of a vehicle as a MAVLink 2 frame, as `mavlink_framing.pack` does. Return its number of bytes.

        The frame begins at the byte `HEAD` of `frame`.

        values: values of a vehicle
        seq, sysid, compid: sequence number, system and component of the sender
        """
        frame = self.frame
        frame[self.end] = frame[self.end + 1] = 0  # the last CRC, which may be in the payload
        for k in range(len(self.fields)):
            value, kind, at = values[self.fields[k, 0]], self.fields[k, 1], self.fields[k, 2]
            if kind == _FLOAT32:
                self.f32[at] = value
            else:
                self._store_whole(value, kind, at)
        size = self.size
        while size > 1 and frame[_PAYLOAD + size - 1] == 0:
            size -= 1
        end = _PAYLOAD + size
        frame[HEAD], frame[HEAD + 1], frame[HEAD + 2], frame[HEAD + 3] = 0xFD, size, 0, 0
        frame[HEAD + 4], frame[HEAD + 5], frame[HEAD + 6] = seq, sysid, compid
        frame[HEAD + 7], frame[HEAD + 8] = self.number & 0xFF, (self.number >> 8) & 0xFF
        frame[HEAD + 9] = self.number >> 16
        frame[end] = self.seed[0]
        crc = mavlink_framing.crc_of_buffer(frame, HEAD + 1, end + 1)
        frame[end], frame[end + 1] = crc & 0xFF, crc >> 8
        self.end = end
        return end + 2 - HEAD

    def _store_whole(self, value: float, kind: int, at: int) -> None:
        """Store a number in the payload as an integer, truncated toward zero and limited to its range. NaN becomes 0.

        at: offset in units of the type's size
        """
        whole = 0
        if not math.isnan(value):
            whole = int(limits.within(value, self.ranges[kind, 0], self.ranges[kind, 1]))
        if kind == _UINT8:
            self.u8[at] = whole
        elif kind == _INT8:
            self.i8[at] = whole
        elif kind == _UINT16:
            self.u16[at] = whole
        elif kind == _INT16:
            self.i16[at] = whole
        elif kind == _UINT32:
            self.u32[at] = whole
        elif kind == _INT32:
            self.i32[at] = whole
        elif kind == _UINT64:
            self.u64[at] = whole
        else:
            self.i64[at] = whole
