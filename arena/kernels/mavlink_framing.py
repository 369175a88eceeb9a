"""Functions that find MAVLink frames in datagrams, and that pack payloads into frames.

`arena.wire.mavlink_frame` describes the layout of frames.

The CRC is computed by fastcrc, which is compiled: it needs 10 ns for a short frame and 60 ns for a long one.
"""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING

from fastcrc import crc16

from arena.kernels.mavlink_frame_types import Frame, ParsedFrames

if TYPE_CHECKING:
    from collections.abc import Container, Mapping

    Fields = tuple[int, int, int, int, int, int, int, int, int]

_V1, _V2 = 0xFE, 0xFD
_V1_HEAD, _V2_HEAD, _CRC, _SIGNATURE = 6, 10, 2, 13
_SIGNED = 0x01
_MAGIC = re.compile(rb"[\xfd\xfe]")
_crc = crc16.mcrf4xx
_pack_head, _pack_crc = struct.Struct("<BBBBBBHB").pack, struct.Struct("<H").pack
_new = tuple.__new__  # a NamedTuple's constructor costs twice as much, and there is one call per message


class FrameParser:
    """Parser that finds the MAVLink frames in datagrams.

    Each datagram is parsed independently of the others.

    seeds: message id -> seed byte CRC_EXTRA, as bytes
    targets: message id -> (payload offset of target_system, of target_component or -1)
    tries: number of false starts after which the rest of a datagram is skipped
    """

    def __init__(
        self, seeds: Mapping[int, bytes], targets: Mapping[int, tuple[int, int]], tries: int
    ) -> None:
        self.seeds, self.targets, self.tries = dict(seeds), dict(targets), tries

    def parse(self, data: bytes) -> ParsedFrames:
        """Return every frame of a datagram, in order. Never raises."""
        return self.search(data, None, 0, 0)

    def search(self, data: bytes, wanted: Container[int] | None, sysid: int, compid: int) -> ParsedFrames:
        """Return the frames of one sender in a datagram, in order. All frames are checked and counted. Never raises.

        wanted: message ids of the frames to return; None returns all frames of all senders
        sysid, compid: system and component of the sender
        """
        frames: list[Frame] = []
        size, at, used, bad_crc, unknown, tries = len(data), 0, 0, 0, 0, 0
        while at < size:
            frame = self.frame_at(data, at, size)
            if frame is not None:
                known = frame[6] in self.seeds
                if self.crc_fits(data, frame) if known else plausible(data, frame, at == used, size):
                    if wanted is None or (frame[4] == sysid and frame[5] == compid and frame[6] in wanted):
                        frames.append(_new(Frame, frame))
                    used += frame[1] - at
                    at = frame[1]
                    unknown += not known
                    continue
                bad_crc += known
            tries += 1
            found = _MAGIC.search(data, at + 1) if tries < self.tries else None
            if found is None:
                break
            at = found.start()
        return _new(ParsedFrames, (frames, size - used, bad_crc, unknown))

    def frame_at(self, data: bytes, at: int, size: int) -> Fields | None:
        """Return the fields of the frame at an offset, with unchecked CRC; None if there is no whole frame.

        at: offset of the first byte of the frame

        size: number of bytes of `data`
        """
        magic = data[at]
        if magic == _V2 and at + _V2_HEAD + _CRC <= size:
            length, flags, payload = data[at + 1], data[at + 2], at + _V2_HEAD
            end = payload + length + _CRC + (_SIGNATURE if flags & _SIGNED else 0)
            if flags > _SIGNED or end > size:  # the standard: a frame with an unknown flag must not be read
                return None
            sysid, compid = data[at + 5], data[at + 6]
            msgid = data[at + 7] + (data[at + 8] << 8) + (data[at + 9] << 16)
        elif magic == _V1 and at + _V1_HEAD + _CRC <= size:
            length, payload = data[at + 1], at + _V1_HEAD
            end = payload + length + _CRC
            if end > size:
                return None
            sysid, compid, msgid = data[at + 3], data[at + 4], data[at + 5]
        else:
            return None
        target_sys = target_comp = 0
        place = self.targets.get(msgid)
        if place is not None:
            system, component = place
            if system < length:
                target_sys = data[payload + system]
            if 0 <= component < length:
                target_comp = data[payload + component]
        return at, end, payload, length, sysid, compid, msgid, target_sys, target_comp

    def crc_fits(self, data: bytes, frame: Fields) -> bool:
        """Return whether the CRC of a frame is right.

        The message must be in the table of seeds (CRC_EXTRA).
        """
        at = frame[2] + frame[3]
        return checksum(data, frame[0] + 1, at, self.seeds[frame[6]]) == data[at] + (data[at + 1] << 8)


def checksum(data: bytes, start: int, end: int, seed: bytes) -> int:
    """Compute the CRC of data[start:end], followed by the seed byte of the message."""
    return _crc(seed, _crc(data[start:end]))


def plausible(data: bytes, frame: Fields, clean: bool, size: int) -> bool:
    """Return whether to accept a frame of an unknown message, whose CRC cannot be checked.

    The frame must follow directly after another frame or at the begin of the datagram, another frame or the end of the
    datagram must follow directly, and the system id must not be 0.

    clean: True if all earlier bytes of the datagram belong to frames
    size: number of bytes of `data`
    """
    end = frame[1]
    return clean and frame[4] != 0 and (end == size or data[end] == _V1 or data[end] == _V2)


def may_contain(data: bytes, first: int, second: int) -> bool:
    """Return whether a datagram may contain one of two messages.

    Reads the frame headers only. A datagram with MAVLink 1 or garbage may contain them.

    first, second: message ids below 256
    """
    at, size = 0, len(data)
    while at + _V2_HEAD + _CRC <= size:
        if data[at] != _V2:
            return True
        if (data[at + 7] == first or data[at + 7] == second) and not (data[at + 8] or data[at + 9]):
            return True
        at += data[at + 1] + _V2_HEAD + _CRC + (_SIGNATURE if data[at + 2] & _SIGNED else 0)
    return False


def pack(payload: bytes, msgid: int, seed: bytes, seq: int, sysid: int, compid: int) -> bytes:
    """Pack a payload into a MAVLink 2 frame, without the zeros at the end of the payload.

    seed: seed byte CRC_EXTRA of the message
    seq, sysid, compid: sequence number, system and component of the sender
    """
    size = len(payload)
    while size > 1 and payload[size - 1] == 0:
        size -= 1
    head = _pack_head(size, 0, 0, seq, sysid, compid, msgid & 0xFFFF, msgid >> 16)
    body = head + (payload if size == len(payload) else payload[:size])
    return b"\xfd" + body + _pack_crc(_crc(body + seed))


def crc_of_buffer(data: memoryview, begin: int, end: int) -> int:
    """Return the CRC of the bytes begin .. end - 1 of a buffer, as fastcrc's `mcrf4xx` computes it for bytes.

    A frame that is written into a buffer needs no copy for it. Four bytes are processed at a time, because a CRC is linear.
    """
    crc = 0xFFFF
    while begin + 4 <= end:
        first, second = data[begin] ^ (crc & 0xFF), data[begin + 1] ^ (crc >> 8)
        crc = _crcs[3, first] ^ _crcs[2, second] ^ _crcs[1, data[begin + 2]] ^ _crcs[0, data[begin + 3]]
        begin += 4
    for k in range(begin, end):
        crc = _next_crc(crc, data[k])
    return crc


def _next_crc(crc: int, byte: int) -> int:
    """Return the CRC after one more byte, with the formula of `crc_accumulate` in MAVLink's C library."""
    part = (byte ^ crc) & 0xFF
    part = (part ^ (part << 4)) & 0xFF
    return (crc >> 8) ^ (part << 8) ^ (part << 3) ^ (part >> 4)


def _table_of_crcs() -> memoryview:
    """Return the CRC, from 0, of each byte followed by 0, 1, 2 or 3 zero bytes (4, 256)."""
    table = memoryview(bytearray(4 * 256 * 2)).cast("H", (4, 256))
    for byte in range(256):
        crc = _next_crc(0, byte)
        for zeros in range(4):
            table[zeros, byte] = crc
            crc = _next_crc(crc, 0)
    return table


_crcs = _table_of_crcs()
