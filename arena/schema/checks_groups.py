"""Checks of groups (vehicles whose programs share a process) and of ranges such as `uav1..uav48`. Pure.

The programs of a group run in one process.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from arena.errors import Problem
from arena.schema.arena import Program, Vehicle
from arena.schema.checking import Check


def _groups(c: Check) -> Iterator[Problem]:
    """Check that all vehicles of a group have the same program, and are all simulated or all real."""
    for v in c.arena.vehicles:
        if v.program is not None and v.program.once and not v.program.group and c.sound(v, "program"):
            said = "got once, but the program has no group. Add `group`, or remove `run`."
            yield c.problem(v.name, ("program", "run"), said)
    for name, vehicles in c.arena.groups.items():
        first = vehicles[0]
        if first.program is not None and not first.program.once and first.program.restart != "never":
            said = (
                f"got {first.program.restart}, but the programs of the group {name} share one process: programs that have landed "
                "would fly again. Use never, or `run: once`."
            )
            yield c.problem(first.name, ("program", "restart"), said)
        if all(c.sound(v, "program", "autopilot") for v in vehicles):
            if (problem := _not_python(c, name, first)) is not None:
                yield problem
            for other in vehicles[1:]:
                yield from _differences(c, name, first, other)


def _not_python(c: Check, group: str, v: Vehicle) -> Problem | None:
    path = Path(v.program.path) if v.program is not None else Path()
    if path.suffix == ".py":
        return None
    said = f"the program of the group {group} is {path.name}, expected a Python file (.py). Remove `group`."
    return c.problem(v.name, ("program", "group"), said)


def _differences(c: Check, group: str, first: Vehicle, other: Vehicle) -> Iterator[Problem]:
    one, two = first.program, other.program
    if one is None or two is None:
        return
    for key, ours, theirs in _settings(one, two):
        if ours != theirs:
            said = f"the group {group} has {theirs} here and {ours} at {first.name}. Use one {key} for a group, or two groups."
            yield c.problem(other.name, ("program", key), said)
    if first.simulated != other.simulated:
        kinds = {True: "simulated", False: "real"}
        said = (
            f"{other.name} is {kinds[other.simulated]}, but {first.name} of the same group {group} is {kinds[first.simulated]}: "
            "they have different clocks. Use two groups."
        )
        yield c.problem(other.name, ("program", "group"), said)


def _settings(one: Program, two: Program) -> Iterator[tuple[str, str, str]]:
    """Yield (key, first value, second value) for each setting that must be equal in two programs of a group."""
    yield "path", one.path, two.path
    yield "restart", one.restart, two.restart
    yield "run", "once" if one.once else "each", "once" if two.once else "each"
    if one.once and two.once:
        yield "args", f"[{', '.join(one.args)}]", f"[{', '.join(two.args)}]"


def _grids(c: Check) -> Iterator[Problem]:
    """Check that `start.grid` is used only for ranges of vehicles, such as `uav1..uav48`.

    It places the vehicles in rows.
    """
    for v in c.arena.vehicles:
        path = c.where(v.name, "start", "grid")
        if c.source.given(path) and c.source.range_of(v.name) is None and c.sound(v, "start"):
            said = f"is for a range such as uav1..uav48, but {v.name} is one vehicle. Remove the key."
            yield c.problem(v.name, ("start", "grid"), said)


GROUPS = (_groups, _grids)
