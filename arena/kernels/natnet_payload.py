"""Reader of the payload of NatNet packets.

`arena.mocap.natnet.codec` describes the format and names the fields.

Every client of a motion-capture server reads 180 frames per second, and needs few of the bodies in them.
"""

from __future__ import annotations

import struct
from math import isfinite
from typing import TYPE_CHECKING

from arena.errors import WireError

if TYPE_CHECKING:
    from collections.abc import Container

    RawBody = tuple[int, float, float, float, float, float, float, float, float, int]
    RawFrame = tuple[int, float, int, int, int, list[RawBody]]

MAX_COUNT = 10_000
"""Greatest number of elements of one kind; a greater number is garbage."""
_BODY = struct.Struct("<i3f4ffh")
_STAMPS = struct.Struct(
    "<IIdQQQ"
)  # time code and its part, time stamp, then ticks at exposure, at reception, at transmission
_HEAD_BYTES, _BODY_BYTES, _LABELLED_BYTES, _STAMPS_BYTES = 4, 38, 26, 40
_SIZED_TAIL_BYTES = (
    _STAMPS_BYTES + 8 + 2 + 4
)  # after a sized frame's last section: stamps, precision stamp, parameters, end
_read_body, _read_stamps = _BODY.unpack_from, _STAMPS.unpack_from


def message_of(data: bytes) -> int:
    """Return the message number of a NatNet packet.

    Raises WireError if the packet is shorter than the size in its header.
    """
    if len(data) < _HEAD_BYTES:
        raise WireError(f"got a NatNet packet of {len(data)} bytes, expected 4 or more")
    size = data[2] + (data[3] << 8)
    if len(data) - _HEAD_BYTES < size:
        raise WireError(
            f"got {len(data) - _HEAD_BYTES} bytes of NatNet payload, expected {size} as in the header of the packet"
        )
    return data[0] + (data[1] << 8)


def payload_of(data: bytes, expected: int) -> bytes:
    """Return the payload of a NatNet packet.

    Raises WireError if its message number is not `expected`.
    """
    message = message_of(data)
    if message != expected:
        raise WireError(f"got a NatNet message of type {message}, expected type {expected}")
    return data[_HEAD_BYTES : _HEAD_BYTES + data[2] + (data[3] << 8)]


class PayloadReader:
    """Reader of a NatNet payload.

    Its position only moves forward and never passes the end.

    data: the payload.  at: position of the next byte.
    """

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def i32(self) -> int:
        """Read a signed integer of four bytes.

        Raises WireError.
        """
        data, at = self.data, self.at
        if at + 4 > len(data):
            raise WireError(
                f"NatNet payload of {len(data)} bytes ends in the middle of a number at byte {at}"
            )
        self.at = at + 4
        highest = data[at + 3]
        if highest > 127:
            highest -= 256
        return data[at] + (data[at + 1] << 8) + (data[at + 2] << 16) + highest * (1 << 24)

    def u16(self) -> int:
        """Read an unsigned integer of two bytes.

        Raises WireError.
        """
        self.skip(2)
        return self.data[self.at - 2] + (self.data[self.at - 1] << 8)

    def count(self, what: str) -> int:
        """Read the number of elements in a list of the payload.

        what: name of the elements, for the error message. Raises WireError.
        """
        value = self.i32()
        if value < 0 or value > MAX_COUNT:
            raise WireError(f"NatNet payload: got {value} {what}, expected 0 to {MAX_COUNT}")
        return value

    def skip(self, size: int) -> None:
        """Skip a number of bytes of the payload.

        Raises WireError.
        """
        if size < 0 or self.at + size > len(self.data):
            raise WireError(
                f"NatNet section of {size} bytes begins at byte {self.at}, but the payload has {len(self.data)} bytes"
            )
        self.at += size

    def section(self) -> bytes:
        """Read the size of a section, then its content. Return the content.

        Raises WireError.
        """
        size = self.i32()
        self.skip(size)
        return self.data[self.at - size : self.at]

    def skip_sections(self, how_many: int) -> None:
        """Skip several sections of the payload.

        A section is a number of elements, its size, and its content. Raises WireError.
        """
        for _ in range(how_many):
            begin = self.at
            if begin + 8 > len(self.data):
                raise WireError(
                    f"NatNet payload of {len(self.data)} bytes ends before the section at byte {begin}"
                )
            self.at += 4
            size = self.i32()
            if size < 0 or self.at + size > len(self.data):
                raise WireError(
                    f"NatNet section of {size} bytes ends at byte {self.at + size}, but the payload has "
                    f"{len(self.data)} bytes"
                )
            self.at += size

    def text(self) -> str:
        """Read a text that ends with a zero byte.

        Raises WireError.
        """
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise WireError(
                f"NatNet payload: the name that begins at byte {self.at} has no zero byte at its end"
            )
        found = self.data[self.at : end]
        self.at = end + 1
        return found.decode(errors="replace")

    def frame(self, wanted: Container[int] | None, version: tuple[int, int], known: bool) -> RawFrame:
        """Read the payload of a FRAME packet.

        Return (frame number, time stamp [s], ticks at exposure, ticks at transmission, parameters, bodies as from `bodies`).

        wanted: streaming ids of the bodies to read, None for all.  version: NatNet version.  known: False if the layout of this version
        may differ, so that the number of bytes after the last section is checked. Raises WireError.
        """
        sized, number = version >= (4, 1), self.i32()
        bodies = self.bodies(wanted, sized)
        self.skip_to_stamps(sized)
        at = self.at
        if not known and len(self.data) - at != _SIZED_TAIL_BYTES:
            raise WireError(
                f"NatNet {version[0]}.{version[1]} frame: got {len(self.data) - at} bytes after the last section, expected "
                f"{_SIZED_TAIL_BYTES}. The layout of this version is not known"
            )
        self.skip(_STAMPS_BYTES)
        _, _, timestamp_s, exposure, _, transmit = _read_stamps(self.data, at)
        if not isfinite(timestamp_s):
            raise WireError(
                f"NatNet frame {number}: got the time stamp {timestamp_s}, expected a finite number"
            )
        if sized:
            self.skip(8)
        return number, timestamp_s, exposure, transmit, self.u16(), bodies

    def bodies(self, wanted: Container[int] | None, sized: bool) -> list[RawBody]:
        """Read the rigid bodies of a frame, and skip everything before them.

        Raises WireError.

        wanted: streaming ids of the bodies to read, None for all.  sized: sections have their size before them (NatNet 4.1 and later)
        Return (streaming id, x, y, z, qx, qy, qz, qw, mean error, parameters) of each body: position and mean error [m] and attitude
        (xyzw), both in the axes of the motion-capture server.
        """
        if sized:
            self.skip_sections(2)
        else:
            for _ in range(self.count("marker sets")):
                self.text()
                self.skip(12 * self.count("markers"))
            self.skip(12 * self.count("loose markers"))
        count = self.count("rigid bodies")
        if sized:
            size = self.i32()
            if size != count * _BODY_BYTES:
                raise WireError(
                    f"NatNet frame: the section of {count} rigid bodies has {size} bytes, expected {count * _BODY_BYTES}"
                )
        begin = self.at
        self.skip(count * _BODY_BYTES)
        end, found = self.at, []
        for k in range(count):
            self.at = begin + k * _BODY_BYTES
            if wanted is None or self.i32() in wanted:
                found.append(_read_body(self.data, begin + k * _BODY_BYTES))
        self.at = end
        return found

    def skip_to_stamps(self, sized: bool) -> None:
        """Skip the sections between the rigid bodies and the time stamps of a frame.

        NatNet versions below 4.1 do not send the sizes of the sections. Raises WireError.
        """
        if sized:
            self.skip_sections(5)
            return
        for _ in range(self.count("skeletons")):
            self.i32()
            self.skip(_BODY_BYTES * self.count("bones"))
        self.skip(_LABELLED_BYTES * self.count("labelled markers"))
        self.skip_samples("force plates")
        self.skip_samples("devices")

    def skip_samples(self, what: str) -> None:
        """Skip the samples of force plates or devices in a frame.

        what: name of the samples, for the error message. Raises WireError.
        """
        for _ in range(self.count(what)):
            self.i32()
            for _ in range(self.count("channels")):
                self.skip(4 * self.count("samples"))
