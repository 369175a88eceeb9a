"""Parameters that PX4 removed, renamed or redefined between versions 1.9 and 1.18.

Pure, apart from reading one file, once. parameter_changes.csv lists the parameters that an indoor multicopter
can have in an old parameter file. Outputs and mixers (PWM_*, CA_*), receivers and other vehicle types are
left out. "PX4 converts it itself" means that PX4 converts a stored value when the new version starts for the
first time. `convert` changes values to the names and numbers of a newer version (never of an older one) and
reports every change.

The column `conversion` defines how a value of the old parameter becomes values of the new parameters:
    (empty)               not converted: no new parameter, or the user must choose a new value
    same                  the same value under every new name
    times F               the value times F
    map NEW 0=4 1=5 / ..  integers by table; an integer that is not in the table is not converted
    replace 4=2           like map, but every other number stays
    keep A..B             numbers from A to B stay, other numbers are not converted; A or B can be left out
    NAME                  the function NAME of `_FUNCTIONS`
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

from arena.errors import InputError
from arena.params.facts.parameter_table import Version

Conversion = Callable[[float], Mapping[str, float]]
"""Function: value of the old parameter -> {new parameter: value}; {} if the value cannot be converted."""


class Change(NamedTuple):
    """A change in PX4 that removed, renamed or redefined one parameter.

    old: name of the parameter.
    since: minor version of the change.
    new: parameters that replace it; () if there are none.
    conversion: conversion of its value; None if the user must choose a new value.
    note: reason for the change.
    source: file in PX4's folder src.
    still_defined: whether PX4 still has the old name after the change, without effect or with another meaning.
    """

    old: str
    since: int
    new: tuple[str, ...]
    conversion: Conversion | None
    note: str
    source: str
    still_defined: bool = False


class ConvertedParams(NamedTuple):
    """Parameters that were converted to a newer PX4 version, with notes for the user.

    values: parameters of the newer version.
    notes: one sentence for each parameter that was renamed, converted or dropped.
    """

    values: Mapping[str, float]
    notes: tuple[str, ...]


def changes(since: Version | str, to: Version | str) -> tuple[Change, ...]:
    """Return PX4's parameter changes after version `since` up to version `to`, oldest first.

    Raises InputError if `to` is older than `since`.
    """
    first, last = (Version.of(v) for v in (since, to))
    if (last.major, last.minor) < (first.major, first.minor):
        raise InputError(
            f"parameters of PX4 {first} cannot be converted to the older PX4 {last}; expected {first} or newer"
        )
    return tuple(change for change in CHANGES if first.minor < change.since <= last.minor)


def successors(name: str, since: Version | str, to: Version | str) -> tuple[str, ...]:
    """Return the names in PX4 version `to` that replace the parameter `name` of version `since`.

    The result is () if no parameter replaces it. If the parameter has not changed, the result is its own
    name.
    """
    names: tuple[str, ...] = (name,)
    for change in changes(since, to):
        if change.old in names:
            names = tuple(new for old in names for new in (change.new if old == change.old else (old,)))
    return tuple(dict.fromkeys(names))


def convert(values: Mapping[str, float], since: Version | str, to: Version | str) -> ConvertedParams:
    """Convert parameters to the names and values of a newer PX4 version.

    If `values` already has a new name, that value is kept. Raises InputError if `to` is older than `since`.
    """
    held = dict(values)
    notes: list[str] = []
    steps = changes(since, to)
    for minor in sorted({change.since for change in steps}):
        here = [c for c in steps if c.since == minor and c.old in held]
        found = [(c, held.pop(c.old)) for c in here]
        # parameters that keep their name are converted first, so that converted values of other parameters do not replace them
        for change, value in sorted(found, key=lambda pair: pair[0].old not in pair[0].new):
            converted = change.conversion(value) if change.conversion else {}
            notes += _notes(change, value, converted, held)
            held = {**converted, **held}
    return ConvertedParams(held, tuple(notes))


def _notes(
    change: Change, value: float, converted: Mapping[str, float], held: Mapping[str, float]
) -> list[str]:
    if converted == {change.old: value}:
        return []
    version = f"PX4 1.{change.since}"
    if not converted:
        return [f"{version}: {change.old} {value:g} is dropped: {change.note}"]
    new = ", ".join(f"{name} {number:g}" for name, number in converted.items())
    kept = [n for n, number in converted.items() if n in held and held[n] != number]
    return [
        f"{version}: {change.old} {value:g} becomes {new}: {change.note}",
        *(f"{version}: {name} stays {held[name]:g}, because it is already given" for name in kept),
    ]


# --- conversions


def _same(new: tuple[str, ...], value: float) -> Mapping[str, float]:
    return dict.fromkeys(new, value)


def _times(factor: float, new: tuple[str, ...], value: float) -> Mapping[str, float]:
    return dict.fromkeys(new, value * factor)


def _map(tables: Mapping[str, Mapping[float, float]], value: float) -> Mapping[str, float]:
    return {name: table[value] for name, table in tables.items() if value in table}


def _replace(table: Mapping[float, float], name: str, value: float) -> Mapping[str, float]:
    return {name: table.get(value, value)}


def _keep(low: float, high: float, name: str, value: float) -> Mapping[str, float]:
    return {name: value} if low <= value <= high else {}


def _ekf2_aid_mask(value: float) -> Mapping[str, float]:
    """Convert the bits of EKF2_AID_MASK to the parameters that replace it in newer PX4 versions.

    Bits: 1 GNSS, 2 optical flow, 4 no accelerometer bias, 8 vision position, 16 vision yaw, 32 drag, 128 GNSS yaw,
    256 vision velocity.
    """
    bits = int(value)
    return {
        "EKF2_EV_CTRL": (3 if bits & 8 else 0) | (4 if bits & 256 else 0) | (8 if bits & 16 else 0),
        "EKF2_GPS_CTRL": (7 if bits & 1 else 0) | (8 if bits & 128 else 0),
        "EKF2_OF_CTRL": 1 if bits & 2 else 0,
        "EKF2_DRAG_CTRL": 1 if bits & 32 else 0,
        "EKF2_IMU_CTRL": 3 if bits & 4 else 7,
    }


def _ekf2_hgt_mode(value: float) -> Mapping[str, float]:
    """Convert EKF2_HGT_MODE to the parameters that replace it: height reference, and a switch per source."""
    mode = int(value)
    return {
        "EKF2_HGT_REF": mode,
        "EKF2_BARO_CTRL": 1 if mode == 0 else 0,
        **({"EKF2_RNG_CTRL": 2} if mode == 2 else {}),
    }


def _ekf2_mag_type(value: float) -> Mapping[str, float]:
    return {"EKF2_MAG_TYPE": value if value in (0, 1, 5) else 0}


def _nav_rcl_act(value: float) -> Mapping[str, float]:
    return {"COM_RCL_EXCEPT": 7} if value == 0 else {"NAV_RCL_ACT": value}


def _mpc_land_rc_help(value: float) -> Mapping[str, float]:
    return {"MPC_AUTO_NUDGING": 2 if value else 0}


def _ekf2_gps_delay(value: float) -> Mapping[str, float]:
    return {"SENS_GPS0_DELAY": int(value), "SENS_GPS1_DELAY": int(value)}


_FUNCTIONS: Mapping[str, Conversion] = {
    "ekf2_aid_mask": _ekf2_aid_mask,
    "ekf2_hgt_mode": _ekf2_hgt_mode,
    "ekf2_mag_type": _ekf2_mag_type,
    "ekf2_gps_delay": _ekf2_gps_delay,
    "nav_rcl_act": _nav_rcl_act,
    "mpc_land_rc_help": _mpc_land_rc_help,
}


def _conversion(text: str, new: tuple[str, ...]) -> Conversion | None:
    """Parse a rule of parameter_changes.csv that converts a parameter's old value to its new values.

    The rule is a cell of the column `conversion`.
    """
    kind, _, rest = text.partition(" ")
    if not kind:
        return None
    if kind == "same":
        return partial(_same, new)
    if kind == "times":
        return partial(_times, float(rest), new)
    if kind == "map":
        tables = (part.split() for part in rest.split("/"))
        return partial(_map, {name: _number_table(pairs) for name, *pairs in tables})
    if kind == "replace":
        return partial(_replace, _number_table(rest.split()), new[0])
    if kind == "keep":
        low, high = rest.split("..")
        return partial(_keep, float(low or -math.inf), float(high or math.inf), new[0])
    return _FUNCTIONS[kind]


def _number_table(pairs: list[str]) -> dict[float, float]:
    """Parse pairs "before=after", such as ["0=4", "1=5"], to a dict, such as {0: 4, 1: 5}."""
    return {int(old): int(new) for old, new in (pair.split("=") for pair in pairs)}


def _read() -> tuple[Change, ...]:
    text = Path(__file__).with_name("parameter_changes.csv").read_text(encoding="utf-8")
    return tuple(
        Change(
            old=name,
            since=Version.parse(row["since"]).minor,
            new=(new := tuple(row["new_names"].split())),
            conversion=_conversion(row["conversion"], new),
            note=row["note"],
            source=row["source"],
            still_defined=row["still_defined"] == "yes",
        )
        for row in csv.DictReader(text.splitlines())
        for name in row["old_names"].split()
    )


CHANGES = _read()
