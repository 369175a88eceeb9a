"""Checks before the first flight of a campaign: each combination of settings must give a valid arena."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from arena.campaign.design import Flight, overrides_of
from arena.campaign.sweep import Sweep
from arena.errors import InputError, Problem
from arena.schema import Arena, load_arena
from arena.schema.loader import YamlPath
from arena.smoke.flying.fly_scenario import refuse_real
from arena.smoke.language.scenario import load_scenarios


def check(sweep: Sweep, flights: Sequence[Flight], on_checked: Callable[[], None] = lambda: None) -> Arena:
    """Check that every combination of settings gives a valid arena. Return the arena of the first flight.

    on_checked: function that is called after each point.
    Raises InputError with all problems. A problem with a varied value has the file and line of the sweep file.
    """
    if not Path(sweep.flown).exists():
        given = sweep.source.value((sweep.kind,))
        raise InputError(sweep.source.problem((sweep.kind,), f"got {given!r}, which does not exist."))
    first: Arena | None = None
    problems: list[Problem] = []
    for flight in {flight.overrides: flight for flight in flights}.values():
        try:
            arena = load(flight)
            first = arena if first is None else first
        except InputError as error:
            if not error.problems:
                raise
            problems += [at_sweep(sweep, flight, p) for p in error.problems]
        on_checked()
    if problems or first is None:
        raise InputError(sorted(dict.fromkeys(problems), key=lambda p: (p.file, p.line)))
    return first


def load(flight: Flight) -> Arena:
    """Return the arena of a flight: its YAML files with the overrides of the flight.

    Raises InputError if the files are wrong, or if a vehicle is real.
    """
    if flight.kind == "arena":
        arena = load_arena(flight.file, flight.overrides)
    else:
        scenarios = load_scenarios(flight.file, flight.overrides)
        if len(scenarios) != 1:
            raise InputError(
                f"{flight.file}: names {len(scenarios)} arenas, expected one in a campaign. Write a scenario file per arena"
            )
        arena = scenarios[0].arena
    refuse_real(arena)
    if flight.kind == "arena" and not any(v.program for v in arena.vehicles):
        raise InputError(
            f"{flight.file}: no vehicle has a program, so nothing would fly. Give a vehicle `program`, or name a `scenario`"
        )
    return arena


def at_sweep(sweep: Sweep, flight: Flight, problem: Problem) -> Problem:
    """Replace the YAML override that a problem names by the line of the sweep file that it comes from.

    The line is 1 if it cannot be found. A problem of another file is returned unchanged.
    """
    if not problem.file.startswith("--set"):
        return problem
    text = problem.file.removeprefix("--set").strip()
    said = f"{problem.field}: {problem.message}" if problem.field else problem.message
    for path, override in reversed(list(_overrides_with_paths(sweep, flight.settings))):
        key = override.partition("=")[0].strip()
        inside = problem.field == key or problem.field.startswith((f"{key}.", f"{key}["))
        if override == text or inside or (key.startswith("defaults.") and _may_come_from(key, problem.field)):
            return sweep.source.problem(path, said)
    return replace(problem, file=sweep.file, line=1)


def _may_come_from(default: str, field: str) -> bool:
    """Return whether a default for all vehicles may have caused a wrong value of one vehicle.

    default: key of the default, such as `defaults.mass`.  field: field with the wrong value, such as `vehicles.uav1.mass`.
    """
    return field.split(".")[:1] == ["vehicles"] and field.split(".")[2:3] == default.split(".")[1:2]


def _overrides_with_paths(sweep: Sweep, settings: Mapping[str, object]) -> Iterator[tuple[YamlPath, str]]:
    """Yield each YAML override of a flight, with its place in the sweep file.

    Each result is (place, override).

    settings: setting -> its value in this flight.
    """
    for i, text in enumerate(sweep.overrides):
        yield ("set", i), text
    for name, setting in sweep.settings.items():
        value = settings[name]
        where: YamlPath = ("vary", name)
        if setting.values is not None and value in setting.values:
            short = isinstance(sweep.source.value(("vary", name)), tuple)
            inner = setting.values.index(value)
            where = ("vary", name, inner) if short else ("vary", name, "values", inner)
        yield from ((where, text) for text in overrides_of(name, setting, value))  # type: ignore[arg-type]


def input_digests(sweep: Sweep, arena: Arena) -> dict[str, str]:
    """Return path -> SHA-256 of each file that determines a flight: arena, scenario, programs, profiles.

    The paths are relative to the folder of the sweep file. Modules that a program imports are not included.
    """
    files = {sweep.flown, arena.file}
    files |= {v.program.path for v in arena.vehicles if v.program}
    files |= {v.profile_key for v in arena.vehicles if v.profile_key.endswith(".yaml")}
    folder = Path(sweep.file).parent
    found = {}
    for name in sorted(files):
        path = Path(name, "arena.yaml") if Path(name).is_dir() else Path(name)
        if path.is_file():
            found[os.path.relpath(path, folder)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found
