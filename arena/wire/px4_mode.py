"""PX4's flight modes: its custom_mode number <-> the words of its ground stations. Light: the panic path imports it."""

from __future__ import annotations

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
AUTO_LAND = (4, 6)


def mode_words(custom_mode: int) -> str:
    """custom_mode: main mode in bits 16 to 23, sub mode in 24 to 31 -> "OFFBOARD", "AUTO.LAND", "AUTO.11", ..."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == 4:
        return f"AUTO.{AUTO.get(sub, sub)}"
    return MAIN.get(main, f"mode {main}")


def mode_numbers(words: str) -> tuple[int, int]:
    """The inverse: PX4's main and sub mode. Raises KeyError for words that are no mode."""
    main, _, sub = words.partition(".")
    return {v: k for k, v in MAIN.items()}[main], {v: k for k, v in AUTO.items()}[sub] if sub else 0
