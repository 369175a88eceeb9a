"""Two sets of parameters compared, of one version of PX4 or of two, or one with its version's defaults. Pure.

What no one sets is left out (`NO_SETTINGS`): calibrations, counters and what the autopilot keeps there for itself.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from arena.params.facts.parameter_table import Parameter, Version, parameters
from arena.params.facts.renames import Carried, carry


class Row(NamedTuple):
    """One name that differs. a, b: None where that side does not have it.  note: what else is to be known, or ""."""

    name: str
    a: float | None
    b: float | None
    note: str


class Kept(NamedTuple):
    """Names (a pattern for the whole of one) that are no settings, and why."""

    names: str
    why: str


NO_SETTINGS: tuple[Kept, ...] = (
    Kept(r"CAL_\w+", "calibration of this vehicle's sensors, and which of them is preferred"),
    Kept(r"TC_\w+", "calibration of this vehicle's sensors over temperature"),
    Kept(r"SENS_DPRES_(OFF|ANSC)", "calibration of this vehicle's air speed sensor"),
    Kept(r"RC\d+_(MIN|MAX|TRIM|REV|DZ)", "calibration of this vehicle's radio"),
    Kept(r"EKF2_MAGBIAS_(X|Y|Z|ID)", "learned in flight"),
    Kept(r"LND_FLIGHT_T_(HI|LO)", "a counter of flight time"),
    Kept(r"COM_FLIGHT_UUID", "a counter of flights"),
    Kept(r"MAV_SYS_ID", "each vehicle has its own"),
    Kept(r"SYS_AUTOCONFIG|SYS_PARAM_VER|SYS_CONFIG_VER|SYS_RESTART_TYPE", "PX4 keeps its own state there"),
    Kept(r"_HASH_CHECK", "a checksum of the others"),
)
_PATTERNS = tuple((re.compile(kept.names), kept.why) for kept in NO_SETTINGS)


def no_setting(name: str) -> str:
    """Why nobody sets this one; "" for what is a setting."""
    return next((why for pattern, why in _PATTERNS if pattern.fullmatch(name)), "")


def same(a: float, b: float, kind: str = "") -> bool:
    """As the autopilot would hold them: INT32 exactly, FLOAT in 32 bits. kind: "" when it is not known."""
    if math.isnan(a) or math.isnan(b):
        return math.isnan(a) and math.isnan(b)
    if kind == "INT32" or (not kind and isinstance(a, int) and isinstance(b, int)):
        return a == b
    return _held(a) == _held(b)


def diff(
    a: Mapping[str, float],
    b: Mapping[str, float],
    version: Version | str = "",
    version_b: Version | str | None = None,
    *,
    every: bool = False,
) -> list[Row]:
    """What differs, by name. version: of `a`, and of `b` where `version_b` is None; "" when it is not known.

    Of two versions the older side is told under the newer one's names and numbers.  every: what is no setting too.
    """
    first = _version(version)
    second = first if version_b is None else _version(version_b)
    a, b = dict(a), dict(b)
    notes: dict[str, str] = {}
    if first and second and first.minor != second.minor:
        older, newer = (a, b) if first < second else (b, a)
        met, notes = _meet(older, newer, min(first, second), max(first, second))
        a, b = (met, newer) if first < second else (newer, met)
    newest = max(first, second) if first and second else first or second
    facts = parameters(newest) if newest else {}
    return [
        Row(name, a.get(name), b.get(name), notes.get(name, "") or _alone(name, a, b, newest, facts))
        for name in _shown(a.keys() | b.keys(), every)
        if not (name in a and name in b and same(a[name], b[name], _kind(name, facts)))
    ]


def against_defaults(
    values: Mapping[str, float], version: Version | str, *, every: bool = False
) -> list[Row]:
    """What is not as PX4 of that version has it, as rows of the value and the default. What the values lack is not told."""
    at = Version.of(version)
    facts = parameters(at)
    return [
        Row(
            name,
            values[name],
            facts[name].default if name in facts else None,
            "" if name in facts else _unknown(at),
        )
        for name in _shown(values, every)
        if name not in facts or not same(values[name], facts[name].default, facts[name].type)
    ]


def _version(given: Version | str) -> Version | None:
    return (Version.parse(given) if given else None) if isinstance(given, str) else given


def _shown(names: Iterable[str], every: bool) -> list[str]:
    return sorted(name for name in names if every or not no_setting(name))


def _kind(name: str, facts: Mapping[str, Parameter]) -> str:
    return facts[name].type if name in facts else ""


def _meet(
    older: Mapping[str, float], newer: Mapping[str, float], since: Version, to: Version
) -> tuple[dict[str, float], dict[str, str]]:
    """The older side under the newer one's names, and by name what became of it."""
    carried = carry(older, since, to).values
    values: dict[str, float] = {}
    notes: dict[str, str] = {}
    for name, value in older.items():
        given: Carried = carry({name: value}, since, to)
        if not given.values:  # nothing takes its place: told under its old name
            values[name], notes[name] = value, "; ".join(given.notes)
            continue
        for new, number in given.values.items():
            values[new] = carried.get(new, number)
            if given.notes and values[new] == number:
                notes[new] = "; ".join(given.notes)
    return values, notes


def _alone(
    name: str,
    a: Mapping[str, float],
    b: Mapping[str, float],
    version: Version | None,
    facts: Mapping[str, Parameter],
) -> str:
    if name in a and name in b:
        return ""
    side = "only the first has it" if name in a else "only the second has it"
    return f"{side}; {_unknown(version)}" if version and name not in facts else side


def _unknown(version: Version) -> str:
    return f"PX4 {version} has no such name"


def _held(value: float) -> float:
    """As a float of 32 bits."""
    try:
        held: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return value
    return held
