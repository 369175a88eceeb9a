"""Loads scenario files: YAML -> frozen `Scenario` objects, or an InputError with all problems and their lines.

This module starts no processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from arena.errors import InputError, Problem
from arena.schema import Arena, load_arena
from arena.schema.arena import Fence
from arena.schema.load import arena_of
from arena.schema.loader import Document, YamlPath, load_yaml
from arena.schema.source import Source, near, show, with_overrides
from arena.schema.validate import validate
from arena.smoke.language.grammar import (
    read_action,
    read_allowance,
    read_expectation,
    read_rule,
    read_trigger,
)
from arena.smoke.language.model import Allowance, Box, Place, Rule, Step
from arena.smoke.language.names import Names, names_of
from arena.smoke.language.scenario_file import STEP_KEYS, ScenarioFile
from arena.smoke.language.tokens import WrongWordError
from arena.smoke.language.vocabulary import VEHICLE_PROCESSES

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Scenario that is flown in one arena.

    name: name of the scenario. If the file lists several arenas, the name ends with the arena: `offboard loss lands [four]`.
    about: one sentence about what the scenario tests; "" if the file has none.
    place: file and line of the scenario's name.
    arena: the loaded arena, with the overrides applied.
    arena_file: path of the arena's YAML, to start it with `arena up`. "" if the arena is written inside the scenario file:
        then first write `arena.plan.resolved_yaml.arena_yaml(scenario.arena)` to a file. That text contains the overrides.
    overrides: `key=value` texts for `arena up --set`.
    time_limit_s: simulated time after which the flight fails [s].
    allowed: failures that the scenario accepts.
    steps, always: entries of the file with these names.
    fence: volume that the vehicles must not leave.
    """

    name: str
    about: str
    place: Place
    arena: Arena
    arena_file: str
    overrides: tuple[str, ...]
    time_limit_s: float
    allowed: Allowance
    steps: tuple[Step, ...]
    always: tuple[Rule, ...]
    fence: Box


def load_scenarios(path: str | Path, overrides: Sequence[str] = ()) -> list[Scenario]:
    """Load a scenario file. Return one Scenario per arena that the file names.

    overrides: `key=value` texts for the arenas; they win over `set` in the file.
    Raises InputError with all problems of the scenario and of its arenas.
    """
    document = load_yaml(path, start="`arena:` and `steps:`")
    if (
        isinstance(document.data, dict)
        and "vehicles" in document.data
        and not {"arena", "steps"} & set(document.data)
    ):
        message = (
            f"got an arena, expected a scenario: write a file with `arena: {Path(path).name}` and `steps:`"
        )
        raise InputError(
            Problem(file=str(path), line=document.line(("vehicles",)), field="", message=message)
        )
    found = validate(ScenarioFile, with_overrides(document, ()))
    problems = list(found.problems)
    if found.model is None:
        raise InputError(_in_order(problems))
    made = []
    for file in _files(found.model.arena):
        reader = _Reader(document, found.model, file, overrides)
        made.append(reader.scenario())
        problems += reader.problems
    if problems:
        raise InputError(_in_order(problems))
    return [scenario for scenario in made if scenario is not None]


def stem(file: str) -> str:
    """Return the name of a scenario file without folder and suffixes.

    Example: `flights/offboard_loss.smoke.yaml` -> `offboard_loss`.
    """
    return Path(file).stem.removesuffix(".smoke")


def _files(arena: Any) -> tuple[str, ...]:
    """Return the paths of the arena files under the key `arena`.

    Return ("",) if the scenario file itself defines the arena.
    """
    if isinstance(arena, dict):
        return ("",)
    return (arena,) if isinstance(arena, str) else tuple(dict.fromkeys(arena))


def _in_order(problems: Sequence[Problem]) -> list[Problem]:
    """Return the problems sorted by file and line. Each key keeps its first problem only."""
    first: dict[tuple[str, int, str], Problem] = {}
    for problem in problems:
        first.setdefault((problem.file, problem.line, problem.field), problem)
    return sorted(first.values(), key=lambda p: (p.file, p.line))


class _Reader:
    """Reader of one scenario for one of its arenas. `problems` collects the problems found."""

    def __init__(self, document: Document, model: ScenarioFile, file: str, overrides: Sequence[str]) -> None:
        self._source = Source(document=document, data=document.data)
        self._model = model
        self._file = file
        self._overrides = (*model.set, *overrides)
        self._folder = Path(document.file).parent
        self.problems: list[Problem] = []

    def scenario(self) -> Scenario | None:
        """Return the scenario, or None if the scenario file has problems."""
        arena = self._load()
        names = names_of(arena) if arena is not None else self._likely_names()
        if names is None:
            return None
        steps, always, allowed = tuple(self._steps(names)), tuple(self._always(names)), self._allowed(names)
        name = self._model.name or stem(self._source.document.file)
        several = isinstance(self._model.arena, tuple) and len(_files(self._model.arena)) > 1
        return (
            None
            if self.problems or arena is None
            else Scenario(
                name=f"{name} [{Path(self._file).stem}]" if several else name,
                about=self._model.about or "",
                place=self._place(("name",), name),
                arena=arena,
                arena_file=str(self._folder / self._file) if self._file else "",
                overrides=self._overrides,
                time_limit_s=self._model.time_limit_s,
                allowed=allowed,
                steps=steps,
                always=always,
                fence=fence_of(arena),
            )
        )

    # -- the arena

    def _load(self) -> Arena | None:
        try:
            if self._file:
                arena = load_arena(self._found(), self._overrides)
            else:
                arena = arena_of(_inside(self._source.document, ("arena",)), self._overrides)
        except InputError as error:
            self.problems += [self._at_scenario(p) for p in error.problems]
            return None
        real = [v.name for v in arena.vehicles if v.autopilot in {"hardware", "hitl"}]
        if real:
            self._wrong(
                ("arena",),
                f"got real vehicles ({', '.join(real)}), expected simulated ones: scenarios inject faults.",
            )
        return arena

    def _likely_names(self) -> Names | None:
        """Return the vehicle and process names of an arena with errors, so that the scenario can still be checked.

        Return None if the names cannot be read.
        """
        try:
            data = load_yaml(self._folder / self._file).data if self._file else self._model.arena
            vehicles = tuple(data["vehicles"])
            tools = tuple(f"tool.{tool}" for tool in data.get("tools") or ())
            copilot = ("copilot",) if "copilot" in data else ()
        except (InputError, KeyError, TypeError, AttributeError):
            return None
        rooms = ("world", "mocap", "router", *copilot)
        processes = (
            *rooms,
            *(form.format(v) for form in VEHICLE_PROCESSES.values() for v in vehicles),
            *tools,
        )
        return Names(vehicles=vehicles, processes=processes) if vehicles else None

    def _found(self) -> Path:
        path = self._folder / self._file
        if not path.exists():
            near_it = sorted(p.name for p in path.parent.glob("*.yaml")) if path.parent.is_dir() else []
            hint = near(path.name, near_it) if near_it else ""
            raise InputError(
                self._source.problem(("arena",), f"got {self._file!r}, which does not exist. {hint}".rstrip())
            )
        return path

    def _at_scenario(self, problem: Problem) -> Problem:
        """Return a problem of the arena's YAML with the file and line of the scenario entry that caused it.

        Such an entry is `set`.

        A problem with another cause is returned unchanged.
        """
        if problem.file.startswith("--set"):
            text = problem.file.removeprefix("--set").strip()
            for i, given in enumerate(self._model.set):
                if given == text or self._overrode(given, problem.field):
                    message = (
                        f"{problem.field}: {problem.message}"
                        if problem.field
                        else f"got {given!r}: {problem.message}"
                    )
                    return self._source.problem(("set", i), message)
        if not self._file and problem.file == self._source.document.file:
            return replace(problem, field=f"arena.{problem.field}" if problem.field else "arena")
        return problem

    def _overrode(self, given: str, field: str) -> bool:
        """Return whether an entry of `set` has set the key `field` of the arena's YAML.

        An entry for a key of `defaults` sets this key for all vehicles.

        given: text of the entry, such as `defaults.autopilot=px4`.  field: dotted YAML key.
        """
        key = given.partition("=")[0].strip()
        sets = [one.partition("=")[0].strip() for one in self._overrides]
        default = key.startswith("defaults.") and field.startswith("vehicles.") and sets.count(key) == 1
        return key == field or (default and field.split(".")[2:3] == key.split(".")[1:2])

    # -- the steps and rules

    def _steps(self, names: Names) -> Iterator[Step]:
        """Yield the steps of the scenario.

        The expectations of an entry with only `expect` are added to the previous step.
        """
        last: Step | None = None
        for i, entry in enumerate(self._model.steps):
            step = self._step(("steps", i), entry, names)
            if step is None:
                continue
            if last is not None and step.trigger is None and not step.do:
                last = replace(last, expect=(*last.expect, *step.expect))
                continue
            if last is not None:
                yield last
            last = step
        if last is not None:
            yield last

    def _step(self, path: YamlPath, entry: Any, names: Names) -> Step | None:
        if not isinstance(entry, dict) or not entry:
            self._wrong(path, f"got {show(entry)}, expected a mapping of {', '.join(STEP_KEYS)}.")
            return None
        for key in (key for key in entry if key not in STEP_KEYS):
            self._wrong((*path, key), f"unknown key. {near(key, list(STEP_KEYS))}")
        triggers = self._read(path, "at", entry, names, read_trigger, single=True)
        return Step(
            place=self._place(path, _step_text(entry)),
            trigger=triggers[0] if triggers else None,
            do=self._read(path, "do", entry, names, read_action),
            expect=self._read(path, "expect", entry, names, read_expectation),
        )

    def _read(
        self,
        path: YamlPath,
        key: str,
        entry: dict[str, Any],
        names: Names,
        read: Callable[[str, Names, Place], T],
        *,
        single: bool = False,
    ) -> tuple[T, ...]:
        """Parse all entries under one key of a step. Wrong entries are reported and left out."""
        if key not in entry:
            return ()
        value, here = entry[key], (*path, key)
        if isinstance(value, tuple) and not single and value:
            made = [self._one((*here, j), text, read, names) for j, text in enumerate(value)]
        else:
            made = [self._one(here, value, read, names)]
        return tuple(one for one in made if one is not None)

    def _one(
        self, path: YamlPath, text: Any, read: Callable[[str, Names, Place], T], names: Names
    ) -> T | None:
        if not isinstance(text, str):
            self._wrong(path, f"got {show(text)}, expected text.")
            return None
        try:
            return read(text, names, self._place(path, text))
        except WrongWordError as error:
            self._wrong(path, str(error))
            return None

    def _always(self, names: Names) -> Iterator[Rule]:
        for i, text in enumerate(self._model.always):
            rule = self._one(("always", i), text, read_rule, names)
            if rule is not None:
                yield rule

    def _allowed(self, names: Names) -> Allowance:
        crash, fail, stay = set[str](), set[str](), False
        for i, text in enumerate(self._model.may):
            one = self._one(("may", i), text, lambda text, names, place: read_allowance(text, names), names)
            if one is not None:
                crash, fail, stay = crash | one.crash, fail | one.fail, stay or one.stay_up
        return Allowance(crash=frozenset(crash), fail=frozenset(fail), stay_up=stay)

    def _place(self, path: YamlPath, text: str) -> Place:
        file, line = self._source.place(path)
        return Place(file=file, line=line, text=text)

    def _wrong(self, path: YamlPath, message: str) -> None:
        self.problems.append(self._source.problem(path, message))


def _step_text(entry: dict[str, Any]) -> str:
    """Return `at` and `do` of a step as one text, which identifies the step in the report."""
    actions = entry.get("do", ())
    done = ", ".join(str(d) for d in actions) if isinstance(actions, tuple) else str(actions)
    return ": ".join(part for part in (f"at {entry['at']}" if "at" in entry else "", done) if part)


def _inside(document: Document, path: YamlPath) -> Document:
    """Return the part of a YAML document below the key `path`, such as the arena inside a scenario file.

    The lines keep the numbers that they have in the file.
    """
    data: Any = document.data
    for part in path:
        data = data[part]
    lines = {at[len(path) :]: line for at, line in document.lines.items() if at[: len(path)] == path}
    return Document(file=document.file, data=data, lines=lines)


def fence_of(arena: Arena) -> Box:
    """Return the box that vehicles must not leave: the geofence, or the room without a geofence.

    It has no lower limit, so vehicles on the floor are inside.
    """
    north, east, height = arena.world.size
    fence = arena.geofence or Fence(
        north=(-north / 2.0, north / 2.0), east=(-east / 2.0, east / 2.0), up=height
    )
    return Box(
        low_n=(fence.north[0], fence.east[0], -fence.up), high_n=(fence.north[1], fence.east[1], math.inf)
    )
