"""Pydantic model of a scenario file: its keys, types and descriptions.

Conditions and actions are still texts.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from arena.schema.base import Strict


def _arena(value: Any) -> Any:
    named = (value,) if isinstance(value, str) else value
    if isinstance(value, dict) or (
        isinstance(named, tuple) and named and all(isinstance(v, str) and v for v in named)
    ):
        return value
    raise ValueError(
        "expected the path of an arena's YAML, a list of such paths, or a mapping that defines an arena"
    )


def _entries(value: Any) -> Any:
    if isinstance(value, tuple):
        return value
    raise ValueError("expected a list")


Entries = Annotated[tuple[Any, ...], BeforeValidator(_entries)]


class ScenarioFile(Strict):
    """Content of a scenario file: arena, time limit, steps, rules and accepted failures."""

    name: Annotated[str, Field(min_length=1, max_length=80)] | None = None
    """The scenario's name. Default: the name of the file."""
    about: Annotated[str, Field(min_length=1, max_length=300)] | None = None
    """Purpose of the scenario in one sentence: the fault, and what the vehicles must do. `arena smoke --list` and the
    report show it. Default: none."""
    arena: Annotated[Any, BeforeValidator(_arena)]
    """The path of the arena's YAML, relative to the scenario file. With a list of paths, the scenario is flown once in
    each arena. A mapping defines the arena here."""
    set: tuple[str, ...] = ()
    """Values that override the arena's YAML, such as `defaults.autopilot=px4` (as `arena up --set`)."""
    time_limit_s: Annotated[float, Field(gt=0, le=3600)] = 60.0
    """Simulated time after which the flight ends and fails [s]."""
    may: Entries = ()
    """Failures that are accepted."""
    steps: Annotated[Entries, Field(min_length=1)]
    """The steps, in order: each entry is a mapping of `at`, `do` and `expect`."""
    always: Entries = ()
    """Rules that must hold for every vehicle in flight: from its first take-off until its landing."""


STEP_KEYS = {
    "at": "the time at which the step begins",
    "do": "an action, or a list of actions",
    "expect": "an expectation, or a list of expectations; its time counts from the last `at` or `do`",
}
