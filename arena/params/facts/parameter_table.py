"""The table of PX4's parameters by version, read once from px4_parameters.csv.

A row is valid from version `since` to version `until`. All patch releases of a minor version share their rows, which come from
its last patch release. v1.16.0 and v1.16.2 do not differ.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple

from arena.errors import InputError

CSV = "px4_parameters.csv"
COLUMNS = ("name", "type", "unit", "default", "min", "max", "reboot", "since", "until", "source")
Type = Literal["INT32", "FLOAT"]
_ROUNDING = 1e-6
_VERSION = re.compile(r"v?(\d{1,2})\.(\d{1,2})(?:\.(\d{1,3}))?(?:[-+ ].*)?")
_HEAD = re.compile(r"# (\d+\.\d+) ([=~]) (.+)")


class Parameter(NamedTuple):
    """Definition of a parameter in one PX4 version: type, unit, default value and limits.

    unit: unit as written by PX4; "" if there is none.
    default: default value in this unit; an int for INT32.
    min, max: PX4's limits in this unit; None if PX4 gives no limit.
    reboot: whether a new value takes effect only after a reboot.
    """

    name: str
    type: Type
    unit: str
    default: float
    min: float | None
    max: float | None
    reboot: bool

    def expected_instead(self, value: float) -> str:
        """Return a text about the allowed values if `value` is not allowed, else "".

        The check is needed because PX4 accepts any number over MAVLink.
        """
        if not math.isfinite(value) or (self.type == "INT32" and not float(value).is_integer()):
            return "an integer" if self.type == "INT32" else "a number"
        least, most = (
            (-math.inf if self.min is None else self.min),
            (math.inf if self.max is None else self.max),
        )
        return "" if least - _ROUNDING <= value <= most + _ROUNDING else _range(least, most)


def _range(least: float, most: float) -> str:
    if math.isinf(most):
        return f"at least {least:g}"
    return f"at most {most:g}" if math.isinf(least) else f"from {least:g} to {most:g}"


@dataclass(frozen=True, order=True)
class Version:
    """A version of PX4, such as 1.16 or 1.16.2.

    All patch releases of a minor version share one parameter set in the table.
    """

    major: int
    minor: int
    patch: int = 0

    @classmethod
    def of(cls, version: Version | str) -> Version:
        """Convert a text such as "1.16" to a `Version`; a `Version` is returned unchanged.

        Raises InputError if the version is not in the table.
        """
        return cls.parse(version) if isinstance(version, str) else version

    @classmethod
    def parse(cls, text: str) -> Version:
        """Return the PX4 version of a text such as 1.16, v1.9.2 or 1.18.0-beta1.

        Raises InputError, with a list of the known versions, if the text is not a version or the version is not in the table.
        """
        found = _VERSION.fullmatch(text.strip())
        if found is None:
            raise InputError(
                f"{text!r} is not a PX4 version; expected a version such as 1.16 or v1.9.2. {_known()}"
            )
        version = cls(*(int(part or 0) for part in found.groups()))
        if version.table not in provenance():
            raise InputError(f"PX4 {text.strip()} is not in the table of parameters. {_known()}")
        return version

    @property
    def table(self) -> str:
        """Return the name of this version in the parameter table: major and minor number, such as "1.16"."""
        return f"{self.major}.{self.minor}"

    def __str__(self) -> str:
        return f"{self.table}.{self.patch}" if self.patch else self.table


class Provenance(NamedTuple):
    """Origin of the table's rows for one PX4 version: PX4's tag or commit.

    text: PX4's tag or commit. released: false if this is a development version.
    """

    text: str
    released: bool


def versions() -> tuple[Version, ...]:
    """Return the PX4 versions of the parameter table, oldest first."""
    return tuple(Version(*map(int, name.split("."))) for name in provenance())


def parameters(version: Version | str) -> Mapping[str, Parameter]:
    """Return {parameter name: definition} of a PX4 version.

    Raises InputError if the version is not in the table.
    """
    return _parameters(_table(version))


def parameter(name: str, version: Version | str) -> Parameter:
    """Return the definition of one parameter in a PX4 version.

    Raises InputError for a version that is not in the table, KeyError for a parameter that the version does not have.
    """
    return parameters(version)[name]


def defaults(version: Version | str) -> Mapping[str, float]:
    """Return {parameter name: default value} of a PX4 version.

    Raises InputError if the version is not in the table.
    """
    return _defaults(_table(version))


def _table(version: Version | str) -> str:
    """Return the name of a PX4 version in the parameter table, such as "1.16".

    Raises InputError if the version is not in the table.
    """
    version = Version.of(version)
    if version.table not in provenance():
        raise InputError(f"PX4 {version} is not in the table of parameters. {_known()}")
    return version.table


@cache
def _defaults(table: str) -> Mapping[str, float]:
    return MappingProxyType({name: p.default for name, p in _parameters(table).items()})


def is_unreleased(version: Version | str) -> bool:
    """Return whether the table's rows of a PX4 version come from a development version.

    This is the case if PX4 had not released the version when the table was made.
    """
    version = Version.of(version)
    return not provenance()[version.table].released


@cache
def provenance() -> Mapping[str, Provenance]:
    """Return {PX4 minor version: origin of its rows in the parameter table}, oldest version first."""
    heads = (found.groups() for line in _parts()[0] if (found := _HEAD.fullmatch(line)))
    return MappingProxyType({name: Provenance(text, mark == "=") for name, mark, text in heads})


class _Parameters(Mapping[str, Parameter]):
    """The parameters of one PX4 version. The rows of a name are parsed at its first use, because the table has thousands of rows."""

    def __init__(self, table: str) -> None:
        self._at = list(provenance()).index(table)
        self._found: dict[str, Parameter | None] = {}

    def __getitem__(self, name: str) -> Parameter:
        if name not in self._found:
            spans = _spans_of(_lines().get(name, []))
            rows = (row for row, since, until in spans if since <= self._at <= until)
            self._found[name] = next(map(_parameter, rows), None)
        parameter = self._found[name]
        if parameter is None:
            raise KeyError(name)
        return parameter

    def __iter__(self) -> Iterator[str]:
        return (name for name in _lines() if name in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)


@cache
def _parameters(table: str) -> Mapping[str, Parameter]:
    return _Parameters(table)


def _parameter(row: list[str]) -> Parameter:
    name, kind, unit, default, least, most, reboot = row[:7]
    number: Callable[[str], float] = int if kind == "INT32" else float
    low, high = number(least) if least else None, number(most) if most else None
    return Parameter(
        name, "INT32" if kind == "INT32" else "FLOAT", unit, number(default), low, high, bool(reboot)
    )


@cache
def _lines() -> Mapping[str, list[str]]:
    """Return {parameter name: its lines of px4_parameters.csv}. A name has several lines if its definition has changed."""
    lines: dict[str, list[str]] = {}
    for line in _parts()[1][1:]:
        lines.setdefault(line[: line.index(",")], []).append(line)
    return lines


def _spans_of(lines: list[str]) -> tuple[tuple[list[str], int, int], ...]:
    """Return each of these lines as (columns, first PX4 version, last PX4 version). A version is its index in `provenance()`."""
    places = {name: place for place, name in enumerate(provenance())}
    return tuple((row, places[row[7]], places[row[8]]) for row in csv.reader(lines))


@cache
def _parts() -> tuple[list[str], list[str]]:
    """Return the comment lines and the table lines of px4_parameters.csv. The comments name PX4's tags."""
    lines = Path(__file__).with_name(CSV).read_text(encoding="utf-8").splitlines()
    head = next(place for place, line in enumerate(lines) if not line.startswith("#"))
    return lines[:head], lines[head:]


def _known() -> str:
    return f"Known: {', '.join(provenance())}."
