"""Files with a vehicle's parameters -> values: QGroundControl's `.params`, and PX4's own logs (ULog).

What a file is, its first bytes tell, not its name. Whether a name or a number makes sense is `check`'s affair, not this page's.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from arena.constants import INT32_MAX, INT32_MIN
from arena.errors import InputError, Problem, WireError
from arena.params.facts.parameter_table import Type
from arena.wire.qgc_params import INTEGERS, Entry, parse_entries
from arena.wire.ulog import MAGIC, parse_ulog

_MOST_FAULTS = 20
_MOST_TEXT = 4_000_000  # bytes; PX4 has a thousand names of a line each
_VERSION = re.compile(r"#\s*Version:\s*v?(\d{1,2}\.\d{1,2}(?:\.\d{1,3})?)\b", re.IGNORECASE)
_EXPECTED = "expected a .params file of QGroundControl, lines `NAME value`, or a ULog of PX4"


@dataclass(frozen=True, kw_only=True)
class Source:
    """values: an int where the file says that it is one.  types: of those whose type the file tells.

    version: of the PX4 that they belong to, such as 1.9.2; "" when the file does not say.
    origin: where they come from, for people.  notes: what to know of the file, one sentence each.
    """

    values: Mapping[str, float]
    types: Mapping[str, Type]
    version: str
    origin: str
    notes: tuple[str, ...] = ()


def read_values(path: Path | str) -> Source:
    """Raises InputError with every line that is wrong: what was found there, and what is expected."""
    path = Path(path)
    data = _read(path)
    if data.startswith(MAGIC):
        return _from_ulog(path, data)
    if path.suffix.lower() == ".ulg":
        _refuse(path, f"got {_seen(data)}, which is no ULog; expected one to begin with 55 4C 6F 67 01 12 35")
    return _from_text(path, data)


def _read(path: Path) -> bytes:
    try:
        if path.exists() and not path.is_file():
            _refuse(path, f"this is no file; {_EXPECTED}")
        return path.read_bytes()
    except FileNotFoundError:
        _refuse(path, f"there is no such file; {_EXPECTED}")
    except (OSError, ValueError) as error:
        _refuse(path, f"it cannot be read: {getattr(error, 'strerror', None) or error}")


def _from_ulog(path: Path, data: bytes) -> Source:
    try:
        log = parse_ulog(data)
    except WireError as error:
        _refuse(path, f"{error}")
    if not log.initial:
        _refuse(path, "the log has no parameters; expected one that PX4 wrote")
    notes = [
        f"{name} was changed in flight: {log.initial[name]:g} became {value:g}"
        for name, value in log.changed.items()
        if log.initial.get(name, value) != value
    ]
    if log.damaged:
        notes.append(
            f"the log is damaged at byte {log.damaged[0]}: what was changed about then may be missing"
        )
    return Source(
        values={**log.initial, **log.changed},
        types=log.types,
        version=_release(log.info.get("ver_sw_release")),
        origin=f"{path} (ULog of {log.info.get('ver_hw', 'a vehicle')})",
        notes=tuple(notes),
    )


def _release(packed: str | float | None) -> str:
    """ver_sw_release: major, minor, patch, kind, a byte each. A version in the making (kind below 64) has its number too."""
    if not isinstance(packed, int) or packed <= 0:
        return ""
    return f"{packed >> 24 & 255}.{packed >> 16 & 255}.{packed >> 8 & 255}"


def _from_text(path: Path, data: bytes) -> Source:
    if len(data) > _MOST_TEXT:
        _refuse(path, f"got {len(data)} bytes of {_seen(data)}; {_EXPECTED}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        _refuse(path, f"got the byte {data[error.start]:#04x}, which is no text; {_EXPECTED}", line)
    if "\0" in text:
        _refuse(
            path,
            f"got a byte of zero, which is no text; {_EXPECTED}",
            text[: text.index("\0")].count("\n") + 1,
        )
    entries, faults = parse_entries(text)
    problems = [_problem(path, f.message, f.line, f.name) for f in faults]
    problems += [_problem(path, said, e.line, e.name) for e in entries if (said := _out_of_type(e))]
    if problems:
        problems.sort(key=lambda p: p.line)
        left = len(problems) - _MOST_FAULTS
        rest = [_problem(path, f"and {left} more lines are wrong; {_EXPECTED}")] if left > 0 else []
        raise InputError(problems[:_MOST_FAULTS] + rest)
    if not entries:
        _refuse(path, f"it holds no parameter; {_EXPECTED}")
    written = _VERSION.search(text)
    return Source(
        values={e.name: e.value for e in entries},
        types={e.name: _type(e.kind) for e in entries if e.kind is not None},
        version=written[1] if written else "",
        origin=str(path),
    )


def _type(kind: int) -> Type:
    return "INT32" if kind in INTEGERS else "FLOAT"


def _out_of_type(entry: Entry) -> str:
    """Why the value is in no type that PX4 has; "" when it is."""
    if entry.kind is not None and entry.kind in INTEGERS and not INT32_MIN <= entry.value <= INT32_MAX:
        return f"got {entry.value:.0f}, expected a whole number from {INT32_MIN} to {INT32_MAX}"
    try:
        struct.pack("<f", entry.value)
    except OverflowError:
        return f"got {entry.value:g}, expected a number that a float of 32 bits can hold"
    return ""


def _seen(data: bytes) -> str:
    return f"a file that begins with {data[:7].hex(' ').upper()}" if data else "an empty file"


def _problem(path: Path, message: str, line: int = 0, field: str = "") -> Problem:
    return Problem(file=str(path), line=line, field=field, message=message)


def _refuse(path: Path, message: str, line: int = 0) -> NoReturn:
    raise InputError(_problem(path, message, line))
