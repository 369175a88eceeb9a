"""CURRENT_MODE (436) and AVAILABLE_MODES (435), by their layout: the `common` dialect of pymavlink does not know them yet.

    CURRENT_MODE     <I I B            custom_mode, intended custom_mode, MAV_STANDARD_MODE
    AVAILABLE_MODES  <I I B B B 35s    custom_mode, properties, how many, which (from 1), MAV_STANDARD_MODE, name

A value here is packed as pymavlink's messages are: `message.pack(voice)`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Protocol

from fastcrc import crc16

AVAILABLE_MODES, CURRENT_MODE = 435, 436
CRC_EXTRA = {AVAILABLE_MODES: 134, CURRENT_MODE: 193}
ADVANCED, NOT_SELECTABLE = 1, 2
"""Bits of `properties`."""
_CURRENT, _AVAILABLE = struct.Struct("<IIB"), struct.Struct("<IIBBB35s")
_HEAD = struct.Struct("<BBBBBBBHB")


class Voice(Protocol):
    """What a pymavlink.MAVLink tells of who speaks."""

    seq: int
    srcSystem: int
    srcComponent: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentMode:
    """intended: what was asked for last; differs from `custom_mode` while a failsafe flies."""

    custom_mode: int
    intended: int
    standard: int = 0

    def pack(self, voice: Voice) -> bytes:
        return _frame(CURRENT_MODE, _CURRENT.pack(self.custom_mode, self.intended, self.standard), voice)


@dataclass(frozen=True, slots=True, kw_only=True)
class AvailableMode:
    """index: from 1 to count. name: empty for a standard mode."""

    custom_mode: int
    index: int
    count: int
    properties: int = 0
    standard: int = 0
    name: str = ""

    def pack(self, voice: Voice) -> bytes:
        given = (self.custom_mode, self.properties, self.count, self.index, self.standard, self.name.encode()[:34])
        return _frame(AVAILABLE_MODES, _AVAILABLE.pack(*given), voice)


def _frame(number: int, payload: bytes, voice: Voice) -> bytes:
    payload = payload.rstrip(b"\0") or b"\0"  # MAVLink 2 leaves zeros at the end away
    head = _HEAD.pack(0xFD, len(payload), 0, 0, voice.seq, voice.srcSystem, voice.srcComponent, number, 0)
    crc: int = crc16.mcrf4xx(head[1:] + payload + bytes((CRC_EXTRA[number],)))
    return head + payload + crc.to_bytes(2, "little")
