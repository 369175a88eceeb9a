"""Reader and writer of QGroundControl's `.params` files (Vehicle Setup > Parameters > Tools, save and load).

    # a comment
    sysid <TAB> component <TAB> NAME <TAB> value <TAB> type        MAV_PARAM_TYPE: 6 int32, 9 float

Plain lines `NAME value` are accepted too. Lines for components other than the autopilot (a camera, a gimbal)
are ignored.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from arena.errors import WireError

INT32, REAL32 = 6, 9
_AUTOPILOT = 1
INTEGERS = range(1, 9)
_TYPES = range(1, 11)
_NAME = re.compile(r"[A-Za-z0-9_]{1,16}")
_ID = re.compile(r"[0-9]{1,3}")
_WHOLE = re.compile(r"[+-]?[0-9]{1,20}")
_NUMBER = re.compile(
    r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,4})?|[+-]?(nan|inf|infinity)", re.IGNORECASE
)
_LAYOUT = "expected five columns (system, component, NAME, value, type), or `NAME value`"


class Entry(NamedTuple):
    """A parameter as read from one line of a .params file.

    kind: MAV_PARAM_TYPE; None if the line has no type
    line: line number, from 1
    """

    name: str
    value: float
    kind: int | None
    line: int


class Fault(NamedTuple):
    """A line of a .params file that cannot be read.

    name: name of the parameter, "" if the line contains no valid name
    message: the text found and the text expected
    """

    line: int
    name: str
    message: str


def parse_entries(text: str) -> tuple[list[Entry], list[Fault]]:
    """Read a .params file. Return its parameters and its wrong lines, in order.

    Parameters of other components are skipped.
    """
    entries: dict[str, Entry] = {}
    faults: list[Fault] = []
    for number, line in enumerate(text.split("\n"), 1):
        words = line.lstrip("\ufeff").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            found = _line(words, number)
        except ValueError as error:
            name = words[0] if len(words) == 2 else words[2] if len(words) == 5 else ""
            faults.append(Fault(number, name if _NAME.fullmatch(name) else "", str(error)))
            continue
        if found is not None and found.name in entries:
            there = entries[found.name].line
            faults.append(
                Fault(
                    number,
                    found.name,
                    f"{found.name} is already on line {there}, expected each name only once",
                )
            )
        elif found is not None:
            entries[found.name] = found
    return list(entries.values()), faults


def parse_params(text: str) -> dict[str, float]:
    """Read a .params file into {name: value}. Integers are int.

    Raises WireError with the number of the first line that has an error.
    """
    entries, faults = parse_entries(text)
    for fault in faults:
        raise WireError(f"line {fault.line}: {fault.message}")
    return {entry.name: entry.value for entry in entries}


def format_params(
    values: Mapping[str, float],
    system: int,
    *,
    header: Sequence[str] = (),
    types: Mapping[str, int] | None = None,
    comments: Mapping[str, str] | None = None,
) -> str:
    """Return parameters as the text of a .params file, which QGroundControl can load.

    system: MAVLink id of the vehicle
    types: name -> MAV_PARAM_TYPE; without it an int is INT32 and a float REAL32
    comments: name -> comment, on the line before the parameter
    """
    lines = [f"# {line}".rstrip() for line in header]
    for name, value in values.items():
        kind = (types or {}).get(name, INT32 if isinstance(value, int) else REAL32)
        if comments and name in comments:
            lines.append(f"# {comments[name]}")
        shown = str(round(value)) if kind in INTEGERS else f"{value:.9g}"
        lines.append(f"{system}\t{_AUTOPILOT}\t{name}\t{shown}\t{kind}")
    return "\n".join(lines) + "\n"


def _line(words: list[str], number: int) -> Entry | None:
    """Parse one line of a .params file, already split into words.

    Return None if the parameter belongs to another MAVLink component than the autopilot. Raises ValueError with the reason
    if the line has an error.
    """
    if len(words) == 2:
        return Entry(_name(words[0]), _value(words[1], None), None, number)
    if len(words) != 5:
        raise ValueError(f"got {len(words)} columns, {_LAYOUT}")
    system, component, name, value, kind = words
    if (
        not (_ID.fullmatch(system) and _ID.fullmatch(component) and _ID.fullmatch(kind))
        or int(kind) not in _TYPES
    ):
        raise ValueError(f"got {' '.join(words)!r}, {_LAYOUT}")
    read = Entry(_name(name), _value(value, int(kind)), int(kind), number)
    return read if int(component) == _AUTOPILOT else None


def _name(word: str) -> str:
    if not _NAME.fullmatch(word):
        raise ValueError(f"{word!r} is not a parameter name (1 to 16 letters, digits and _), {_LAYOUT}")
    return word


def _value(word: str, kind: int | None) -> float:
    whole = _WHOLE.fullmatch(word) is not None
    if not _NUMBER.fullmatch(word):  # float() would take 1_000 and the digits of other scripts
        raise ValueError(f"{word!r} is not a number, expected one such as 4 or 0.5")
    value = float(word)
    if not math.isfinite(value):
        raise ValueError(f"{word} is not a value for a parameter, expected a finite number")
    if kind is not None and kind in INTEGERS and not whole:
        raise ValueError(f"{word} is not an integer, but the type {kind} is an integer type")
    return int(word) if whole and kind != REAL32 else value
