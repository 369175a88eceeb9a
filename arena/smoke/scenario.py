"""Scenario files: YAML -> frozen `Scenario`s, or an InputError with every problem and its line. Starts nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from arena.schema import Arena
from arena.smoke.words import Allowance, Box, Place, Rule, Step


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One scenario in one arena.

    name: with the arena's stem, `offboard loss lands [four]`, where the file names several. arena: as loaded, with overrides.
    arena_file: what `arena up` is given, with `--set` for each of overrides; "" for an arena written inside the scenario: then
    write `arena.plan.text.arena_yaml(scenario.arena)` to a file and fly that, its paths are absolute and overrides are in it.
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


def load_scenarios(path: str | Path, overrides: Sequence[str] = ()) -> list[Scenario]:
    """One Scenario per arena that the file names. overrides: `key=value` texts laid over the file's own `set`.

    Raises InputError; its `problems` are those of the scenario and of its arenas.
    """
    raise NotImplementedError
