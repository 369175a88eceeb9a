"""QGroundControl's `.params` text <-> values: what its Vehicle Setup > Parameters > Tools saves and loads.

    # a comment
    sysid <TAB> component <TAB> NAME <TAB> value <TAB> type        MAV_PARAM_TYPE: 6 int32, 9 float

Plain lines `NAME value` are read as well. Lines of other components than the autopilot (a camera, a gimbal) are passed over.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from arena.errors import WireError

INT32, REAL32 = 6, 9
_AUTOPILOT = 1
INTEGERS = range(1, 9)
_TYPES = range(1, 11)
_NAME = re.compile(r"[A-Za-z0-9_]{1,16}")
_WHOLE = re.compile(r"[+-]?\d+")
_LAYOUT = "expected five columns (system, component, NAME, value, type), or `NAME value`"


def parse_params(text: str) -> dict[str, float]:
    """-> {name: value}; whole numbers as int. Raises WireError with the number of the first line that is wrong."""
    found: dict[str, float] = {}
    lines: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        words = line.lstrip("\ufeff").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            read = _line(words)
        except ValueError as error:
            raise WireError(f"line {number}: {error}") from None
        if read is None:
            continue
        name, value = read
        if name in found:
            raise WireError(f"line {number}: {name} stands on line {lines[name]} already")
        found[name], lines[name] = value, number
    return found


def format_params(
    values: Mapping[str, float], system: int, *, header: Sequence[str] = (), types: Mapping[str, int] | None = None
) -> str:
    """types: MAV_PARAM_TYPE by name where it is known; elsewhere an int is INT32 and a float REAL32."""
    lines = [f"# {line}".rstrip() for line in header]
    for name, value in values.items():
        kind = (types or {}).get(name, INT32 if isinstance(value, int) else REAL32)
        shown = str(round(value)) if kind in INTEGERS else f"{value:.9g}"
        lines.append(f"{system}\t{_AUTOPILOT}\t{name}\t{shown}\t{kind}")
    return "\n".join(lines) + "\n"


def _line(words: list[str]) -> tuple[str, float] | None:
    """(name, value), or None for another component's. Raises ValueError with what is wrong."""
    if len(words) == 2:
        return _name(words[0]), _value(words[1], None)
    if len(words) != 5:
        raise ValueError(f"got {len(words)} columns, {_LAYOUT}")
    system, component, name, value, kind = words
    if not (system.isdecimal() and component.isdecimal() and kind.isdecimal()) or int(kind) not in _TYPES:
        raise ValueError(f"got {' '.join(words)!r}, {_LAYOUT}")
    read = _name(name), _value(value, int(kind))
    return read if int(component) == _AUTOPILOT else None


def _name(word: str) -> str:
    if not _NAME.fullmatch(word):
        raise ValueError(f"{word!r} is no parameter's name (1 to 16 letters, digits and _), {_LAYOUT}")
    return word


def _value(word: str, kind: int | None) -> float:
    whole = _WHOLE.fullmatch(word) is not None
    try:
        value = float(word)
    except ValueError:
        raise ValueError(f"{word!r} is no number") from None
    if not math.isfinite(value):
        raise ValueError(f"{word} is no value for a parameter, expected a finite number")
    if kind is not None and kind in INTEGERS and not whole:
        raise ValueError(f"{word} is no whole number, and type {kind} is one")
    return int(word) if whole and kind != REAL32 else value
