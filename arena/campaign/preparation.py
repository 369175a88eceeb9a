"""Checks before the first flight of a campaign: each combination of settings must give a valid arena."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from arena.campaign.design import Flight, overrides_of
from arena.campaign.effects import override_problem, without_effect
from arena.campaign.inputs import digests, files_of, px4_of
from arena.campaign.sweep import Sweep
from arena.errors import InputError, Problem
from arena.schema import Arena, load_arena
from arena.schema.loader import YamlPath, load_yaml
from arena.schema.ranges import expand_ranges
from arena.smoke.flying.fly_scenario import refuse_real
from arena.smoke.language.scenario import load_scenarios


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """Result of the checks: the arena of the first flight, and what determines all flights.

    inputs: path relative to the folder of the sweep file -> SHA-256 of each file that determines a flight.
    """

    arena: Arena
    inputs: Mapping[str, str]


def check(sweep: Sweep, flights: Sequence[Flight], on_checked: Callable[[], None] = lambda: None) -> Prepared:
    """Check that every combination of settings gives a valid arena, and that every setting has an effect.

    on_checked: function that is called after each point.
    Raises InputError with all problems. A problem with a varied value has the file and line of the sweep file.
    """
    if not Path(sweep.flown).exists():
        given = sweep.source.value((sweep.kind,))
        raise InputError(sweep.source.problem((sweep.kind,), f"got {given!r}, which does not exist."))
    _refuse(_without_influence(sweep, flights[0]))
    files, px4s = set[Path](), set[str]()
    problems: list[Problem] = []
    points: dict[Sequence[str], Flight] = {}
    for flight in flights:  # flights of one point differ only in their seeds
        points.setdefault(flight.overrides, flight)
    for flight in points.values():
        try:
            arena = load(flight)
            files |= files_of(sweep.flown, arena)
            px4s |= px4_of(arena)
        except InputError as error:
            if not error.problems:
                raise
            problems += [at_sweep(sweep, flight, p) for p in error.problems]
        on_checked()
    _refuse(problems)
    said = (
        "has no effect: all its values give the same flight. `arena check` names parameters without effect."
    )
    _refuse(sweep.source.problem(("vary", name), said) for name in without_effect(sweep, flights[0], load))
    return Prepared(arena=load(flights[0]), inputs=digests(files, Path(sweep.file).parent, px4s))


def _refuse(problems: Iterable[Problem]) -> None:
    """Raise InputError with all problems, sorted by their lines, if there are any."""
    if found := dict.fromkeys(problems):
        raise InputError(sorted(found, key=lambda p: (p.file, p.line)))


def _without_influence(sweep: Sweep, flight: Flight) -> Iterator[Problem]:
    """Yield a problem for each override that has no influence on a flight.

    It belongs to a vehicle that the arena does not have, or to a value that the campaign sets itself.

    flight: first flight of the campaign.
    """
    vehicles = _vehicles_of(sweep, flight)
    for path, override in _overrides_with_paths(sweep, flight.settings):
        if said := override_problem(override, vehicles):
            yield sweep.source.problem(path[:2], said)


def _vehicles_of(sweep: Sweep, flight: Flight) -> list[str] | None:
    """Return the vehicles that the YAML names, or that an override such as `vehicles.uav3={}` adds as a whole.

    Return None if they are not known: the arena of a scenario, or an override of all vehicles.
    """
    keys = [text.partition("=")[0].strip().split(".") for text in flight.overrides]
    if sweep.kind != "arena" or ["vehicles"] in keys:
        return None
    path = Path(sweep.flown)
    data, _ = expand_ranges(load_yaml(path / "arena.yaml" if path.is_dir() else path))
    named = data.get("vehicles") if isinstance(data, dict) else None
    added = [key[1] for key in keys if key[0] == "vehicles" and len(key) == 2]
    return [*(named if isinstance(named, dict) else ()), *added]


def load(flight: Flight) -> Arena:
    """Return the arena of a flight: its YAML files with the overrides of the flight.

    Raises InputError if the files are wrong, or if a vehicle is real.
    """
    overrides = (*flight.overrides, "sim.speed=max")  # as it is flown
    if flight.kind == "arena":
        arena = load_arena(flight.file, overrides)
    else:
        scenarios = load_scenarios(flight.file, overrides)
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
