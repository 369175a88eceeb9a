"""MAVLink 1 and 2 frames: finds frames in datagrams and packs payloads into frames. Reads only headers and
target ids.

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
import struct
from typing import NamedTuple, Protocol

from fastcrc import crc16

from arena.wire.mavlink_targets import CRC_EXTRA, TARGETS

AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1: component id of every autopilot."""
TRIES = 32
_V1, _V2 = 0xFE, 0xFD
_V1_HEAD, _V2_HEAD, _CRC, _SIGNATURE = 6, 10, 2, 13
_SIGNED = 0x01
_MAGIC = re.compile(rb"[\xfd\xfe]")
SEEDS = {number: bytes([extra]) for number, extra in CRC_EXTRA.items()}
"""Message id -> seed byte CRC_EXTRA, the last byte that the CRC includes."""
_HEAD, _LITTLE = struct.Struct("<BBBBBBHB"), struct.Struct("<H")
_crc = crc16.mcrf4xx
_new = tuple.__new__  # a NamedTuple's constructor costs twice as much, and there is one call per message

Buffer = bytes | bytearray | memoryview


class MavlinkSender(Protocol):
    """Identity of a sender: its system id, component id and next sequence number.

    The attributes have the names of `pymavlink.MAVLink`, so that an object of that class fits too.
    """

    seq: int
    srcSystem: int
    srcComponent: int


def pack_frame(msgid: int, payload: bytes, sender: MavlinkSender, crc_extra: bytes) -> bytes:
    """Pack a payload into a MAVLink 2 frame, without the zeros at its end. Does not increase the sequence
    number.
    """
    if not payload[-1]:
        payload = payload.rstrip(b"\0") or b"\0"
    body = (
        _HEAD.pack(
            len(payload), 0, 0, sender.seq, sender.srcSystem, sender.srcComponent, msgid & 0xFFFF, msgid >> 16
        )
        + payload
    )
    return b"\xfd" + body + _LITTLE.pack(_crc(body + crc_extra))


class Frame(NamedTuple):
    """Position of a frame in its buffer, with its sender and its target.

    start, end: byte range with magic, CRC and signature
    payload, size: offset and length of the payload as sent
    sysid, compid: sender
    target_sys, target_comp: 0 if the message has no target, or is for all
    """

    start: int
    end: int
    payload: int
    size: int
    sysid: int
    compid: int
    msgid: int
    target_sys: int
    target_comp: int


class ParsedFrames(NamedTuple):
    """All frames of a datagram.

    garbage: number of bytes that belong to no frame
    bad_crc: number of frames of a known message with a wrong CRC
    unknown: number of frames whose message is not in the table; they are accepted because their length fits
    """

    frames: list[Frame]
    garbage: int
    bad_crc: int
    unknown: int


def parse_frames(data: Buffer) -> ParsedFrames:
    """Return every frame of a datagram, in order. Never raises."""
    frames: list[Frame] = []
    size, at, used, bad_crc, unknown, tries = len(data), 0, 0, 0, 0, 0
    while at < size:
        frame = _frame_at(data, at, size)
        if frame is not None:
            seed = SEEDS.get(frame[6])
            if _plausible(data, frame, at == used, size) if seed is None else _crc_fits(data, frame, seed):
                frames.append(frame)
                used += frame[1] - at
                at = frame[1]
                unknown += seed is None
                continue
            bad_crc += seed is not None
        tries += 1
        found = _MAGIC.search(data, at + 1) if tries < TRIES else None
        if found is None:
            break
        at = found.start()
    return _new(ParsedFrames, (frames, size - used, bad_crc, unknown))


class Stream:
    """Finds frames in a byte stream, such as a serial line. The stream is passed in pieces of any length; a frame
    can begin in one piece and end in a later one.

    A frame is returned when it is complete and its CRC is correct. After a false start the search continues
    at the next byte, so at most one frame's length is buffered. A message that is not in the table is
    accepted only between two other frames.
    """

    def __init__(self) -> None:
        self._kept = b""
        self._clean = True  # the kept bytes begin at the end of a frame

    def feed(self, data: Buffer) -> tuple[bytes, ParsedFrames]:
        """Add the next piece of the stream. Return a buffer and the frames that are now complete in this buffer. Never raises."""
        buffer = self._kept + bytes(data)
        frames: list[Frame] = []
        size, at, garbage, bad_crc, unknown = len(buffer), 0, 0, 0, 0
        while at < size:
            if not _begins(buffer, at, size):
                found = _MAGIC.search(buffer, at + 1)
                at, garbage, self._clean = self._skip(at, found.start() if found else size, garbage)
                continue
            frame = _frame_at(buffer, at, size)
            seed = None if frame is None else SEEDS.get(frame[6])
            if frame is None or (seed is None and frame[1] == size):
                break  # incomplete, or an unknown message that only the next byte can confirm
            if (
                _plausible(buffer, frame, self._clean, size)
                if seed is None
                else _crc_fits(buffer, frame, seed)
            ):
                frames.append(frame)
                at, self._clean = frame[1], True
                unknown += seed is None
                continue
            bad_crc += seed is not None
            found = _MAGIC.search(buffer, at + 1)
            at, garbage, self._clean = self._skip(at, found.start() if found else size, garbage)
        self._kept = buffer[at:]
        return buffer, _new(ParsedFrames, (frames, garbage, bad_crc, unknown))

    @staticmethod
    def _skip(at: int, to: int, garbage: int) -> tuple[int, int, bool]:
        return to, garbage + to - at, False


def byte_at(data: Buffer, frame: Frame, offset: int) -> int:
    """Return one byte of the payload; 0 beyond the end of the payload."""
    return data[frame.payload + offset] if offset < frame.size else 0


def uint_at(data: Buffer, frame: Frame, offset: int, width: int) -> int:
    """Return a little-endian unsigned integer of the payload; bytes beyond the end of the payload are 0."""
    end = frame.payload + min(offset + width, frame.size)
    return int.from_bytes(data[frame.payload + offset : end], "little")


def _frame_at(data: Buffer, at: int, size: int) -> Frame | None:
    """Return the frame that begins at `at`, without checking its CRC; None if no frame begins there or the frame
    is incomplete.
    """
    magic = data[at]
    if magic == _V2 and at + _V2_HEAD + _CRC <= size:
        length, flags, payload = data[at + 1], data[at + 2], at + _V2_HEAD
        end = payload + length + _CRC + (_SIGNATURE if flags & _SIGNED else 0)
        if flags & ~_SIGNED or end > size:  # the standard: a frame with an unknown flag must not be read
            return None
        sysid, compid = data[at + 5], data[at + 6]
        msgid = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
    elif magic == _V1 and at + _V1_HEAD + _CRC <= size:
        length, payload = data[at + 1], at + _V1_HEAD
        end = payload + length + _CRC
        if end > size:
            return None
        sysid, compid, msgid = data[at + 3], data[at + 4], data[at + 5]
    else:
        return None
    place = TARGETS.get(msgid)
    if place is None:
        return _new(Frame, (at, end, payload, length, sysid, compid, msgid, 0, 0))
    system, component = place
    target_sys = data[payload + system] if system < length else 0
    target_comp = data[payload + component] if 0 <= component < length else 0
    return _new(Frame, (at, end, payload, length, sysid, compid, msgid, target_sys, target_comp))


def _begins(data: Buffer, at: int, size: int) -> bool:
    """Return whether a frame may begin at `at`, judged by the header bytes received so far."""
    if data[at] == _V2:
        return at + 2 >= size or not data[at + 2] & ~_SIGNED
    return data[at] == _V1


def _crc_fits(data: Buffer, frame: Frame, seed: bytes) -> bool:
    start, _, payload, size = frame[:4]
    at = payload + size
    expected: int = _crc(seed, _crc(data[start + 1 : at]))
    return expected == data[at] | data[at + 1] << 8


def _plausible(data: Buffer, frame: Frame, clean: bool, size: int) -> bool:
    """Return whether to accept a frame of an unknown message. The CRC of such a frame cannot be checked, so the
    bytes before and after it must belong to frames.

    clean: all earlier bytes of the datagram belong to frames
    """
    return clean and frame.sysid != 0 and (frame.end == size or data[frame.end] in (_V1, _V2))
