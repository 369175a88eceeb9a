"""Readers of files with PX4 parameters: QGroundControl's `.params` files, and PX4's logs (ULog).

The kind of a file is detected from its first bytes, not from its name. This module only reads names and values; `checks`
checks them.
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

_MAX_PROBLEMS = 20
_MAX_TEXT_BYTES = 4_000_000  # PX4 has about a thousand parameters, one line each
_VERSION = re.compile(r"#\s*Version:\s*v?(\d{1,2}\.\d{1,2}(?:\.\d{1,3})?)\b", re.IGNORECASE)
_EXPECTED = "expected a .params file of QGroundControl, lines `NAME value`, or a ULog of PX4"


@dataclass(frozen=True, kw_only=True)
class ParamSource:
    """A set of PX4 parameters, with information about its source: a file, a log, a vehicle or a YAML.

    values: parameter -> value; an int if the source gives the type INT32.
    types: parameter -> type; empty if the source has no types.
    version: PX4 version, such as 1.9.2; "" if unknown.
    origin: name of the source, for messages.
    notes: remarks for the user about the source, one sentence each.
    """

    values: Mapping[str, float]
    types: Mapping[str, Type]
    version: str
    origin: str
    notes: tuple[str, ...] = ()


def read_values(path: Path | str) -> ParamSource:
    """Read the parameters in a `.params` file or a ULog.

    Raises InputError with a list of all wrong lines.
    """
    path = Path(path)
    data = _read(path)
    if data.startswith(MAGIC):
        return _parse_ulog_file(path, data)
    if path.suffix.lower() == ".ulg":
        _refuse(
            path,
            f"got {_first_bytes(data)}, which is not a ULog; expected the first bytes 55 4C 6F 67 01 12 35",
        )
    return _parse_text(path, data)


def _read(path: Path) -> bytes:
    try:
        if path.exists() and not path.is_file():
            _refuse(path, f"this is not a file; {_EXPECTED}")
        return path.read_bytes()
    except FileNotFoundError:
        _refuse(path, f"the file does not exist; {_EXPECTED}")
    except (OSError, ValueError) as error:
        _refuse(path, f"the file cannot be read: {getattr(error, 'strerror', None) or error}")


def _parse_ulog_file(path: Path, data: bytes) -> ParamSource:
    try:
        log = parse_ulog(data)
    except WireError as error:
        _refuse(path, f"{error}")
    if not log.initial:
        _refuse(path, "the log has no parameters; expected a log that PX4 wrote")
    notes = [
        f"{name} changed in flight from {log.initial[name]:g} to {value:g}"
        for name, value in log.changed.items()
        if log.initial.get(name, value) != value
    ]
    if log.damaged:
        notes.append(
            f"the log is damaged at byte {log.damaged[0]}: changes of parameters near it may be missing"
        )
    return ParamSource(
        values={**log.initial, **log.changed},
        types=log.types,
        version=_release(log.info.get("ver_sw_release")),
        origin=f"{path} (ULog of {log.info.get('ver_hw', 'a vehicle')})",
        notes=tuple(notes),
    )


def _release(packed: str | float | None) -> str:
    """Convert the number ver_sw_release of a ULog to a PX4 version such as `1.16.0`; "" if it is missing.

    The four bytes are major, minor, patch, release type.
    """
    if not isinstance(packed, int) or packed <= 0:
        return ""
    return f"{packed >> 24 & 255}.{packed >> 16 & 255}.{packed >> 8 & 255}"


def _parse_text(path: Path, data: bytes) -> ParamSource:
    if len(data) > _MAX_TEXT_BYTES:
        _refuse(path, f"got {len(data)} bytes of {_first_bytes(data)}; {_EXPECTED}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        _refuse(path, f"got the byte {data[error.start]:#04x}, which is not text; {_EXPECTED}", line)
    if "\0" in text:
        _refuse(
            path,
            f"got a zero byte, which is not text; {_EXPECTED}",
            text[: text.index("\0")].count("\n") + 1,
        )
    entries, wrong = parse_entries(text)
    problems = [_problem(path, f.message, f.line, f.name) for f in wrong]
    problems += [_problem(path, message, e.line, e.name) for e in entries if (message := _type_error(e))]
    if problems:
        problems.sort(key=lambda p: p.line)
        more = len(problems) - _MAX_PROBLEMS
        rest = [_problem(path, f"and {more} more lines are wrong; {_EXPECTED}")] if more > 0 else []
        raise InputError(problems[:_MAX_PROBLEMS] + rest)
    if not entries:
        _refuse(path, f"the file has no parameters; {_EXPECTED}")
    written = _VERSION.search(text)
    return ParamSource(
        values={e.name: e.value for e in entries},
        types={e.name: _type(e.kind) for e in entries if e.kind is not None},
        version=written[1] if written else "",
        origin=str(path),
    )


def _type(kind: int) -> Type:
    return "INT32" if kind in INTEGERS else "FLOAT"


def _type_error(entry: Entry) -> str:
    """Return an error text if a parameter value does not fit its type (INT32 or FLOAT), else ""."""
    if entry.kind is not None and entry.kind in INTEGERS and not INT32_MIN <= entry.value <= INT32_MAX:
        return f"got {entry.value:.0f}, expected an integer from {INT32_MIN} to {INT32_MAX}"
    try:
        struct.pack("<f", entry.value)
    except OverflowError:
        return f"got {entry.value:g}, expected a number in the range of a 32-bit float"
    return ""


def _first_bytes(data: bytes) -> str:
    return f"a file that begins with {data[:7].hex(' ').upper()}" if data else "an empty file"


def _problem(path: Path, message: str, line: int = 0, field: str = "") -> Problem:
    return Problem(file=str(path), line=line, field=field, message=message)


def _refuse(path: Path, message: str, line: int = 0) -> NoReturn:
    raise InputError(_problem(path, message, line))
