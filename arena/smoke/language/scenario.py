"""Scenario files: YAML -> frozen `Scenario`s, or an InputError with every problem and its line. Starts nothing."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BeforeValidator, Field

from arena.errors import InputError, Problem
from arena.plan.make import process_names
from arena.schema import Arena, load_arena
from arena.schema.arena import Fence
from arena.schema.base import Strict
from arena.schema.load import arena_of
from arena.schema.loader import Document, YamlPath, load_yaml
from arena.schema.source import Source, near, show, with_overrides
from arena.schema.validate import validate
from arena.smoke.language.grammar import (
    Names,
    read_allowance,
    read_deed,
    read_expectation,
    read_moment,
    read_rule,
)
from arena.smoke.language.model import Allowance, Box, Place, Rule, Step
from arena.smoke.language.tokens import WrongWordError
from arena.smoke.language.vocabulary import OF_VEHICLES

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One scenario in one arena.

    name: with the arena's stem, `offboard loss lands [four]`, where the file names several. arena: as loaded, with overrides.
    arena_file: what `arena up` is given, with `--set` for each of overrides; "" for an arena written inside the scenario: then
    write `arena.plan.resolved_yaml.arena_yaml(scenario.arena)` to a file and fly that, its paths are absolute and overrides are in it.
    fence: where vehicles may be. allowed: what is not counted as a failure.
    """

    name: str
    place: Place
    arena: Arena
    arena_file: str
    overrides: tuple[str, ...]
    time_limit_s: float
    allowed: Allowance
    steps: tuple[Step, ...]
    always: tuple[Rule, ...]
    fence: Box


def _arena(value: Any) -> Any:
    named = (value,) if isinstance(value, str) else value
    if isinstance(value, dict) or (
        isinstance(named, tuple) and named and all(isinstance(v, str) and v for v in named)
    ):
        return value
    raise ValueError("the arena's file, a list of such files, or a mapping: the arena itself")


def _entries(value: Any) -> Any:
    if isinstance(value, tuple):
        return value
    raise ValueError("a list")


Entries = Annotated[tuple[Any, ...], BeforeValidator(_entries)]


class ScenarioFile(Strict):
    """A whole scenario."""

    name: Annotated[str, Field(min_length=1, max_length=80)] | None = None
    """What it is called. Default: the name of its file."""
    arena: Annotated[Any, BeforeValidator(_arena)]
    """The arena's file, relative to the scenario's; a list flies the scenario once in each; a mapping is the arena itself."""
    set: tuple[str, ...] = ()
    """Overrides of the arena, as `--set`: `defaults.autopilot=px4`."""
    time_limit_s: Annotated[float, Field(gt=0, le=3600)] = 60.0
    """Simulated time after which the flight is over, and failed [s]."""
    may: Entries = ()
    """What is not counted as a failure."""
    steps: Annotated[Entries, Field(min_length=1)]
    """What happens, in order: each entry is a mapping of `at`, `do` and `expect`."""
    always: Entries = ()
    """Rules that hold for whoever is in flight: from its first take-off until its landing."""


STEP_KEYS = {
    "at": "a moment; the step waits for it",
    "do": "a deed, or a list of deeds",
    "expect": "what must be seen, counted from the last `at` or `do`; or a list of that, all counted from there",
}


def load_scenarios(path: str | Path, overrides: Sequence[str] = ()) -> list[Scenario]:
    """One Scenario per arena that the file names. overrides: `key=value` texts laid over the file's own `set`.

    Raises InputError; its `problems` are those of the scenario and of its arenas.
    """
    document = load_yaml(path, start="`arena:` and `steps:`")
    if (
        isinstance(document.data, dict)
        and "vehicles" in document.data
        and not {"arena", "steps"} & set(document.data)
    ):
        said = (
            f"is an arena, and a scenario is needed. One that names it, `arena: {Path(path).name}`, flies it"
        )
        raise InputError(Problem(file=str(path), line=document.line(("vehicles",)), field="", message=said))
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
    """`flights/offboard_loss.smoke.yaml` -> offboard_loss."""
    return Path(file).stem.removesuffix(".smoke")


def _files(arena: Any) -> tuple[str, ...]:
    """Those that are named; "" for the arena itself."""
    if isinstance(arena, dict):
        return ("",)
    return (arena,) if isinstance(arena, str) else tuple(dict.fromkeys(arena))


def _in_order(problems: Sequence[Problem]) -> list[Problem]:
    """One for each place, though several arenas find it."""
    first: dict[tuple[str, int, str], Problem] = {}
    for problem in problems:
        first.setdefault((problem.file, problem.line, problem.field), problem)
    return sorted(first.values(), key=lambda p: (p.file, p.line))


class _Reader:
    """Reads one scenario for one arena, and keeps what is wrong."""

    def __init__(self, document: Document, model: ScenarioFile, file: str, overrides: Sequence[str]) -> None:
        self._source = Source(document=document, data=document.data)
        self._model = model
        self._file = file
        self._overrides = (*model.set, *overrides)
        self._folder = Path(document.file).parent
        self.problems: list[Problem] = []

    def scenario(self) -> Scenario | None:
        """None where something is wrong."""
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
            self.problems += [self._told_here(p) for p in error.problems]
            return None
        real = [v.name for v in arena.vehicles if v.autopilot in {"hardware", "hitl"}]
        if real:
            self._wrong(
                ("arena",),
                f"{', '.join(real)}: a scenario flies simulated vehicles alone, and these are real.",
            )
        return arena

    def _likely_names(self) -> Names | None:
        """Of an arena that is wrong: enough to find what else is. None when even that cannot be read."""
        try:
            data = load_yaml(self._folder / self._file).data if self._file else self._model.arena
            vehicles = tuple(data["vehicles"])
            tools = tuple(f"tool.{tool}" for tool in data.get("tools") or ())
            copilot = ("copilot",) if "copilot" in data else ()
        except (InputError, KeyError, TypeError, AttributeError):
            return None
        rooms = ("world", "mocap", "router", *copilot)
        processes = (*rooms, *(form.format(v) for form in OF_VEHICLES.values() for v in vehicles), *tools)
        return Names(vehicles=vehicles, processes=processes) if vehicles else None

    def _found(self) -> Path:
        path = self._folder / self._file
        if not path.exists():
            near_it = sorted(p.name for p in path.parent.glob("*.yaml")) if path.parent.is_dir() else []
            hint = near(path.name, near_it) if near_it else ""
            raise InputError(
                self._source.problem(("arena",), f"got {self._file!r}, which is not there. {hint}".rstrip())
            )
        return path

    def _told_here(self, problem: Problem) -> Problem:
        """A problem of the arena, with the place in the scenario where it comes from there."""
        if problem.file.startswith("--set"):
            text = problem.file.removeprefix("--set").strip()
            for i, given in enumerate(self._model.set):
                if given == text or self._gave(given, problem.field):
                    said = (
                        f"{problem.field}: {problem.message}"
                        if problem.field
                        else f"got {given!r}: {problem.message}"
                    )
                    return self._source.problem(("set", i), said)
        if not self._file and problem.file == self._source.document.file:
            return replace(problem, field=f"arena.{problem.field}" if problem.field else "arena")
        return problem

    def _gave(self, given: str, field: str) -> bool:
        """Whether this override is the one that set the field: by its own name, or as the default of every vehicle."""
        key = given.partition("=")[0].strip()
        sets = [one.partition("=")[0].strip() for one in self._overrides]
        default = key.startswith("defaults.") and field.startswith("vehicles.") and sets.count(key) == 1
        return key == field or (default and field.split(".")[2:3] == key.split(".")[1:2])

    # -- what is to happen

    def _steps(self, names: Names) -> Iterator[Step]:
        """Entries that expect alone belong to the step before."""
        last: Step | None = None
        for i, entry in enumerate(self._model.steps):
            step = self._step(("steps", i), entry, names)
            if step is None:
                continue
            if last is not None and step.moment is None and not step.do:
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
        moments = self._read(path, "at", entry, names, read_moment, single=True)
        return Step(
            place=self._place(path, _in_words(entry)),
            moment=moments[0] if moments else None,
            do=self._read(path, "do", entry, names, read_deed),
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
        """All that stands under one key of a step; what is wrong is kept, and left out."""
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


def names_of(arena: Arena) -> Names:
    return Names(
        vehicles=tuple(v.name for v in arena.vehicles),
        processes=tuple(process_names(arena)),
        rotors={v.name: v.profile.num_rotors for v in arena.vehicles},
    )


def _in_words(entry: dict[str, Any]) -> str:
    """A step for people, without what it expects."""
    deeds = entry.get("do", ())
    done = ", ".join(str(d) for d in deeds) if isinstance(deeds, tuple) else str(deeds)
    return ": ".join(part for part in (f"at {entry['at']}" if "at" in entry else "", done) if part)


def _inside(document: Document, path: YamlPath) -> Document:
    """What stands at this path as a document of its own, with its lines."""
    data: Any = document.data
    for part in path:
        data = data[part]
    lines = {at[len(path) :]: line for at, line in document.lines.items() if at[: len(path)] == path}
    return Document(file=document.file, data=data, lines=lines)


def fence_of(arena: Arena) -> Box:
    """The arena's geofence, or the walls of its room where it draws none. The floor is no fence."""
    north, east, height = arena.world.size
    fence = arena.geofence or Fence(
        north=(-north / 2.0, north / 2.0), east=(-east / 2.0, east / 2.0), up=height
    )
    return Box(
        low_n=(fence.north[0], fence.east[0], -fence.up), high_n=(fence.north[1], fence.east[1], math.inf)
    )
