"""CURRENT_MODE (436) and AVAILABLE_MODES (435), by their layout: the `common` dialect of pymavlink does not know them yet.

    CURRENT_MODE     <I I B            custom_mode, intended custom_mode, MAV_STANDARD_MODE
    AVAILABLE_MODES  <I I B B B 35s    custom_mode, properties, how many, which (from 1), MAV_STANDARD_MODE, name

A value here is packed as pymavlink's messages are: `message.pack(voice)`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from arena.wire.mavlink_frame import Voice, frame

AVAILABLE_MODES, CURRENT_MODE = 435, 436
SEEDS = {AVAILABLE_MODES: bytes([134]), CURRENT_MODE: bytes([193])}
ADVANCED, NOT_SELECTABLE = 1, 2
"""Bits of `properties`."""
_CURRENT, _AVAILABLE = struct.Struct("<IIB"), struct.Struct("<IIBBB35s")


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentMode:
    """intended: what was asked for last; differs from `custom_mode` while a failsafe flies."""

    custom_mode: int
    intended: int
    standard: int = 0

    def pack(self, voice: Voice) -> bytes:
        payload = _CURRENT.pack(self.custom_mode, self.intended, self.standard)
        return frame(CURRENT_MODE, payload, voice, SEEDS[CURRENT_MODE])


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
        given = (
            self.custom_mode,
            self.properties,
            self.count,
            self.index,
            self.standard,
            self.name.encode()[:34],
        )
        return frame(AVAILABLE_MODES, _AVAILABLE.pack(*given), voice, SEEDS[AVAILABLE_MODES])
