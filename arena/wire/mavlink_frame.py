"""MAVLink 1 and 2 frames: finds frames in datagrams and packs payloads into frames.

Reads only headers and target ids.

    MAVLink 1   FE len seq sys comp id                          payload  crc lo, hi
    MAVLink 2   FD len incompat compat seq sys comp id id id    payload  crc lo, hi  [13 bytes of signature]

The CRC is X.25 (mcrf4xx) over all bytes between the magic byte and the CRC, then the message's seed byte
(CRC_EXTRA).
A datagram contains whole frames, so an incomplete frame at its end is garbage. MAVLink 2 truncates zeros at
the end of a payload, so a byte beyond the end of the payload is 0. The work per datagram is bounded: after
`TRIES` false starts the rest of the datagram is skipped.
"""

from __future__ import annotations

import re
from typing import Protocol

from arena.kernels.mavlink_frame_types import Frame, ParsedFrames
from arena.kernels.mavlink_framing import FrameParser, pack, plausible
from arena.wire.mavlink_targets import CRC_EXTRA, TARGETS

__all__ = [
    "AUTOPILOT",
    "PARSER",
    "SEEDS",
    "TRIES",
    "Buffer",
    "Frame",
    "MavlinkSender",
    "ParsedFrames",
    "Stream",
    "byte_at",
    "pack_frame",
    "parse_frames",
    "uint_at",
]
AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1: component id of every autopilot."""
TRIES = 32
_V1, _V2 = 0xFE, 0xFD
_SIGNED = 0x01
_MAGIC = re.compile(rb"[\xfd\xfe]")
SEEDS = {number: bytes([extra]) for number, extra in CRC_EXTRA.items()}
"""Message id -> seed byte CRC_EXTRA, the last byte that the CRC includes."""

Buffer = bytes | bytearray | memoryview


class MavlinkSender(Protocol):
    """Identity of a sender: its system id, component id and next sequence number.

    The attributes have the names of `pymavlink.MAVLink`, so that an object of that class fits too.
    """

    seq: int
    srcSystem: int
    srcComponent: int


def pack_frame(msgid: int, payload: bytes, sender: MavlinkSender, crc_extra: bytes) -> bytes:
    """Return a MAVLink 2 frame with a payload. Zeros at the end of the payload are left out.

    The caller increases the sequence number of `sender`.
    """
    return pack(payload, msgid, crc_extra, sender.seq, sender.srcSystem, sender.srcComponent)


PARSER = FrameParser(SEEDS, TARGETS, TRIES)
"""Finds MAVLink frames in datagrams. Kernels use it directly, all others `parse_frames`."""
_parse = PARSER.parse


def parse_frames(data: Buffer) -> ParsedFrames:
    """Return every frame of a datagram, in order. Never raises."""
    return _parse(data if type(data) is bytes else bytes(data))


class Stream:
    """Finds MAVLink frames in a byte stream, such as a serial line.

    The stream is passed in pieces of any length; a frame can begin in one piece and end in a later one.

    A frame is returned when it is complete and its CRC is correct. After a false start the search continues
    at the next byte, so at most one frame's length is buffered. A message that is not in the table is
    accepted only between two other frames.
    """

    def __init__(self) -> None:
        self._kept = b""
        self._clean = True  # the kept bytes begin at the end of a frame

    @property
    def is_clean(self) -> bool:
        """True if the next byte begins a frame: all bytes before it belong to whole frames."""
        return self._clean and not self._kept

    def feed(self, data: Buffer) -> tuple[bytes, ParsedFrames]:
        """Parse the next bytes of the stream. Return a buffer and the complete frames in it. Never raises an error."""
        buffer = self._kept + bytes(data)
        frames: list[Frame] = []
        size, at, garbage, bad_crc, unknown = len(buffer), 0, 0, 0, 0
        while at < size:
            if not _begins(buffer, at, size):
                found = _MAGIC.search(buffer, at + 1)
                at, garbage, self._clean = self._skip(at, found.start() if found else size, garbage)
                continue
            frame = PARSER.frame_at(buffer, at, size)
            seed = None if frame is None else SEEDS.get(frame[6])
            if frame is None or (seed is None and frame[1] == size):
                break  # incomplete, or an unknown message that only the next byte can confirm
            if (
                plausible(buffer, frame, self._clean, size)
                if seed is None
                else PARSER.crc_fits(buffer, frame)
            ):
                frames.append(Frame._make(frame))
                at, self._clean = frame[1], True
                unknown += seed is None
                continue
            bad_crc += seed is not None
            found = _MAGIC.search(buffer, at + 1)
            at, garbage, self._clean = self._skip(at, found.start() if found else size, garbage)
        self._kept = buffer[at:]
        return buffer, ParsedFrames(frames, garbage, bad_crc, unknown)

    @staticmethod
    def _skip(at: int, to: int, garbage: int) -> tuple[int, int, bool]:
        return to, garbage + to - at, False


def byte_at(data: Buffer, frame: Frame, offset: int) -> int:
    """Return one byte of the payload. Bytes beyond the end of the payload are 0."""
    return data[frame.payload + offset] if offset < frame.size else 0


def uint_at(data: Buffer, frame: Frame, offset: int, width: int) -> int:
    """Return a little-endian unsigned integer of the payload. Bytes beyond the end of the payload are 0."""
    end = frame.payload + min(offset + width, frame.size)
    return int.from_bytes(data[frame.payload + offset : end], "little")


def _begins(data: Buffer, at: int, size: int) -> bool:
    """Return whether a frame may begin at the position `at`, according to its received header bytes."""
    if data[at] == _V2:
        return at + 2 >= size or not data[at + 2] & ~_SIGNED
    return data[at] == _V1
