"""PX4's flight modes: converts custom_mode numbers to names and back, and encodes two mode messages.

The names are those that ground stations show.

pymavlink's `common` dialect does not contain these messages yet, so this module packs them itself:

    CURRENT_MODE (436)     <I I B          custom_mode, intended_custom_mode, standard_mode
    AVAILABLE_MODES (435)  <I I B B B 35s  custom_mode, properties, number_modes, mode_index (from 1), standard_mode, mode_name

`land-all` imports this module, so it must not import pymavlink.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from arena.wire.mavlink_frame import SEEDS, MavlinkSender, pack_frame

MAIN = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
}
"""PX4 main modes."""
AUTO = {
    1: "READY",
    2: "TAKEOFF",
    3: "LOITER",
    4: "MISSION",
    5: "RTL",
    6: "LAND",
    8: "FOLLOW_TARGET",
    9: "PRECLAND",
    10: "VTOL_TAKEOFF",
}
"""PX4 sub modes of AUTO."""
MANUAL_MODES = frozenset({"MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED", "RATTITUDE"})
"""Names of the modes in which a person steers with sticks."""
_ORBIT = (3, 1)  # PX4 flies a circle by itself: no manual mode, though its main mode is POSCTL
AUTO_LAND = (4, 6)
"""Main and sub mode of AUTO.LAND."""

AVAILABLE_MODES, CURRENT_MODE = 435, 436
ADVANCED, NOT_SELECTABLE = 1, 2
"""MAV_MODE_PROPERTY: bits of `properties`."""
_AVAILABLE = struct.Struct("<IIBBB35s")
_MAX_NAME_BYTES = 34


def split_mode(custom_mode: int) -> tuple[int, int]:
    """Return PX4's main mode (bits 16 to 23) and sub mode (bits 24 to 31) of a custom_mode."""
    return custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF


def mode_words(custom_mode: int) -> str:
    """Return the name of a custom_mode, such as "OFFBOARD" or "AUTO.LAND".

    An unknown number gives "AUTO.11" or "mode 9".
    """
    main, sub = split_mode(custom_mode)
    if (main, sub) == _ORBIT:
        return "ORBIT"
    if main == 4:
        return f"AUTO.{AUTO.get(sub, sub)}"
    return MAIN.get(main, f"mode {main}")


def mode_numbers(words: str) -> tuple[int, int]:
    """Return (main mode, sub mode) of a name as returned by `mode_words`.

    Raises KeyError for an unknown name.
    """
    if words == "ORBIT":
        return _ORBIT
    main, _, sub = words.partition(".")
    return {v: k for k, v in MAIN.items()}[main], {v: k for k, v in AUTO.items()}[sub] if sub else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class AvailableMode:
    """Contents of AVAILABLE_MODES, which describes one flight mode of an autopilot.

    index: 1 to `count`
    name: empty for a standard mode
    """

    custom_mode: int
    index: int
    count: int
    properties: int = 0
    standard: int = 0
    name: str = ""

    def pack(self, sender: MavlinkSender) -> bytes:
        fields = (
            self.custom_mode,
            self.properties,
            self.count,
            self.index,
            self.standard,
            self.name.encode()[:_MAX_NAME_BYTES],
        )
        return pack_frame(AVAILABLE_MODES, _AVAILABLE.pack(*fields), sender, SEEDS[AVAILABLE_MODES])
