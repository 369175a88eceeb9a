"""Comparison of two parameter sets, or of one set with PX4's defaults. Pure.

The sets can be of different PX4 versions. Parameters that users do not set are left out (`NOT_SETTINGS`):
calibrations, counters and the autopilot's own state.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from arena.params.facts.parameter_changes import convert
from arena.params.facts.parameter_table import Parameter, Version, parameters


class Difference(NamedTuple):
    """A parameter whose values differ between two sets.

    a, b: values in the first and second set; None if the set does not have the parameter.
    note: remark for the user, or "".
    """

    name: str
    a: float | None
    b: float | None
    note: str


class ExcludedNames(NamedTuple):
    """Parameter names that comparisons leave out, because they are not settings of the user.

    Examples are calibrations and counters.

    names: regular expression that matches the whole parameter name.
    why: the reason for leaving them out.
    by_itself: PX4 changes the value by itself, so a vehicle cannot be required to have it.
    """

    names: str
    why: str
    by_itself: bool = False


NOT_SETTINGS: tuple[ExcludedNames, ...] = (
    ExcludedNames(r"CAL_\w+", "calibration and priority of this vehicle's sensors", True),
    ExcludedNames(r"TC_\w+", "temperature calibration of this vehicle's sensors"),
    ExcludedNames(r"SENS_BOARD_(X|Y|Z)_OFF", "level calibration of this vehicle"),
    ExcludedNames(r"SENS_DPRES_(OFF|ANSC)", "calibration of this vehicle's airspeed sensor"),
    ExcludedNames(r"RC\d+_(MIN|MAX|TRIM|REV|DZ)", "calibration of this vehicle's RC"),
    ExcludedNames(r"EKF2_MAGBIAS_(X|Y|Z|ID)", "learned in flight", True),
    ExcludedNames(r"LND_FLIGHT_T_(HI|LO)", "a counter of flight time", True),
    ExcludedNames(r"COM_FLIGHT_UUID", "a counter of flights", True),
    ExcludedNames(r"MAV_SYS_ID", "every vehicle has its own"),
    ExcludedNames(r"SYS_AUTOCONFIG|SYS_PARAM_VER|SYS_CONFIG_VER|SYS_RESTART_TYPE", "PX4's own state", True),
    ExcludedNames(r"_HASH_CHECK", "a checksum of the other parameters", True),
)
_PATTERNS = tuple((re.compile(excluded.names), excluded.why) for excluded in NOT_SETTINGS)
_BY_ITSELF = tuple(re.compile(excluded.names) for excluded in NOT_SETTINGS if excluded.by_itself)


def exclusion_reason(name: str) -> str:
    """Return why comparisons leave out a parameter, such as "a counter of flights"; "" if they include it."""
    return next((why for pattern, why in _PATTERNS if pattern.fullmatch(name)), "")


def changes_by_itself(name: str) -> bool:
    """Return whether PX4 changes a parameter by itself, such as a counter of flights."""
    return any(pattern.fullmatch(name) for pattern in _BY_ITSELF)


def same(a: float, b: float, kind: str = "") -> bool:
    """Return whether an autopilot would store two values as the same value.

    INT32 values are compared exactly, FLOAT values in 32 bits.

    kind: type of the parameter. "" if unknown; then two Python ints count as INT32.
    """
    if math.isnan(a) or math.isnan(b):
        return math.isnan(a) and math.isnan(b)
    if kind == "INT32" or (not kind and isinstance(a, int) and isinstance(b, int)):
        return a == b
    return _as_float32(a) == _as_float32(b)


def diff(
    a: Mapping[str, float],
    b: Mapping[str, float],
    version: Version | str = "",
    version_b: Version | str | None = None,
    *,
    include_excluded: bool = False,
) -> list[Difference]:
    """Return the parameters whose values differ between two sets, sorted by name.

    Values of the older PX4 version are converted to the newer version first.

    version: PX4 version of `a`; "" if unknown.
    version_b: PX4 version of `b`; None for the same version as `a`.
    include_excluded: also compare parameters that users do not set.
    """
    first = _version(version)
    second = first if version_b is None else _version(version_b)
    a, b = dict(a), dict(b)
    notes: dict[str, str] = {}
    if first and second and first.minor != second.minor:
        older, newer = (a, b) if first < second else (b, a)
        converted, notes = _converted(older, min(first, second), max(first, second))
        a, b = (converted, newer) if first < second else (newer, converted)
    newest = max(first, second) if first and second else first or second
    table = parameters(newest) if newest else {}
    return [
        Difference(
            name, a.get(name), b.get(name), notes.get(name, "") or _one_sided(name, a, b, newest, table)
        )
        for name in _compared(a.keys() | b.keys(), include_excluded)
        if not (name in a and name in b and same(a[name], b[name], _type(name, table)))
    ]


def _version(given: Version | str) -> Version | None:
    return (Version.parse(given) if given else None) if isinstance(given, str) else given


def _compared(names: Iterable[str], include_excluded: bool) -> list[str]:
    return sorted(name for name in names if include_excluded or not exclusion_reason(name))


def _type(name: str, table: Mapping[str, Parameter]) -> str:
    return table[name].type if name in table else ""


def _converted(
    older: Mapping[str, float], since: Version, to: Version
) -> tuple[dict[str, float], dict[str, str]]:
    """Convert parameter values to a newer PX4 version. Return the values, and {new name: note for the user}."""
    together = convert(older, since, to).values
    values: dict[str, float] = {}
    notes: dict[str, str] = {}
    for name, value in older.items():
        alone = convert({name: value}, since, to)
        if not alone.values:  # no parameter replaces it, so it is shown under its old name
            values[name], notes[name] = value, "; ".join(alone.notes)
            continue
        for new, number in alone.values.items():
            values[new] = together.get(new, number)
            if alone.notes and values[new] == number:
                notes[new] = "; ".join(alone.notes)
    return values, notes


def _one_sided(
    name: str,
    a: Mapping[str, float],
    b: Mapping[str, float],
    version: Version | None,
    table: Mapping[str, Parameter],
) -> str:
    if name in a and name in b:
        return ""
    side = "only in the first" if name in a else "only in the second"
    return f"{side}; {_unknown(version)}" if version and name not in table else side


def _unknown(version: Version) -> str:
    return f"PX4 {version} has no such parameter"


def _as_float32(value: float) -> float:
    try:
        held: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return value
    return held
