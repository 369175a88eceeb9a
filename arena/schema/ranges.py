"""Ranges of vehicles: the key `uav1..uav48` under `vehicles` stands for 48 vehicles with the same settings. Pure."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from arena.errors import InputError, Problem
from arena.schema.loader import Document, YamlPath
from arena.schema.models import Grid
from arena.wire.mavlink_ids import LARGEST_VEHICLE_ID

_RANGE = re.compile(r"([A-Za-z][A-Za-z0-9_-]*?)(\d+)\.\.([A-Za-z][A-Za-z0-9_-]*?)?(\d+)")

Place = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class RangeMember:
    """Position of one vehicle in a range of vehicles such as `uav1..uav48`.

    key: the range, such as `uav1..uav48`. index: place of the vehicle in the range; 0 for the first.
    """

    key: str
    index: int


def expand_ranges(document: Document) -> tuple[Any, dict[str, RangeMember]]:
    """Replace every range such as `uav1..uav48` by its vehicles.

    Return the new values of the document, and vehicle name -> its range.

    Raises InputError for a wrong range, and for a name that is given twice.
    """
    data = document.data
    vehicles = data.get("vehicles") if isinstance(data, dict) else None
    if not isinstance(vehicles, dict) or not any(isinstance(k, str) and ".." in k for k in vehicles):
        return data, {}
    found: dict[str, Any] = {}
    members: dict[str, RangeMember] = {}
    problems = []
    for key, value in vehicles.items():
        names = list(_names(key)) if isinstance(key, str) and ".." in key else None
        if names == []:
            said = (
                f"got {key!r}, expected a range such as uav1..uav48: one name, two rising numbers, "
                f"at most {LARGEST_VEHICLE_ID} vehicles."
            )
            problems.append(_problem(document, key, said))
        for index, name in enumerate([key] if names is None else names):
            if name in found:
                said = f"{name} is given twice: also by {members[name].key if name in members else name}. Remove one of them."
                problems.append(_problem(document, key, said))
            found[name] = value if names is None else copy.deepcopy(value)
            if names is not None:
                members[name] = RangeMember(key=key, index=index)
    if problems:
        raise InputError(problems)
    return {**data, "vehicles": found}, members


def place_in_grid(first: Place, grid: Grid, index: int) -> Place:
    """Return the start position of one vehicle of a range that is placed in a grid [m] [NED].

    first: start of the first
    vehicle. index: 0 for the first.
    """
    row, column = divmod(index, grid.columns)
    north, east, down = first
    return round(north - row * grid.spacing_m, 9), round(east + column * grid.spacing_m, 9), down


def _names(key: str) -> Iterator[str]:
    """Yield the vehicle names of a range such as `uav1..uav48`.

    Yields nothing if the text is not a range.
    """
    found = _RANGE.fullmatch(key)
    if found is None or found[3] not in (None, "", found[1]):
        return
    first, last = int(found[2]), int(found[4])
    if first < last < first + LARGEST_VEHICLE_ID:
        yield from (f"{found[1]}{number}" for number in range(first, last + 1))


def _problem(document: Document, key: str, said: str) -> Problem:
    path: YamlPath = ("vehicles", key)
    return Problem(file=document.file, line=document.line(path), field=f"vehicles.{key}", message=said)
