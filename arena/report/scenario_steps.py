"""Steps of a smoke flight in order of time.

Each expectation names the step from which its time counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from arena.report.run_data import RunData


@dataclass(frozen=True, kw_only=True)
class ScenarioStep:
    """Step of a smoke flight that passed or failed, or a rule of its scenario that was violated.

    number: number on the page, in order of time, from 1.
    at_s: time at which the step was fulfilled or failed, or its rule was broken [s].  A step that failed without such a time has the
    time at which it began.  text: the entry of the scenario file.  good: passed.
    since: number of the step from which the time of an expectation (`within`, `for`) counts, 0 if it has none.
    since_s: time at which this step was done [s]; NaN for `since` 0.
    """

    number: int
    at_s: float
    text: str
    good: bool
    since: int = 0
    since_s: float = math.nan

    @property
    def words(self) -> str:
        """Text of the step. The text of an expectation also names the step from which the time is counted."""
        return f"{self.text} (time counts from step {self.since})" if self.since else self.text


def scenario_steps(run: RunData) -> list[ScenarioStep]:
    """Return the steps and the failed rules of a smoke flight in order of time.

    Steps at the same time keep the order of the file.
    """
    verdict = run.scenario.get("verdict") or {}
    given = [(step, _step_time(step)) for step in verdict.get("steps", ())]
    given += [
        (rule, rule.get("at_s")) for rule in verdict.get("rules", ()) if rule.get("outcome") == "failed"
    ]
    known = sorted(((one, float(at)) for one, at in given if at is not None), key=lambda pair: pair[1])
    numbers = {id(one): number for number, (one, _) in enumerate(known, start=1)}
    begun = _begun(verdict.get("steps", ()))
    made = []
    for one, at in known:
        step = ScenarioStep(
            number=numbers[id(one)],
            at_s=at,
            text=str(one["place"]["text"]),
            good=one.get("outcome") == "passed",
        )
        origin = begun.get(id(one))
        if origin is not None and id(origin) in numbers:
            step = replace(step, since=numbers[id(origin)], since_s=float(origin["done_s"]))
        made.append(step)
    return made


def _step_time(step: Mapping[str, Any]) -> float | None:
    if step.get("outcome") == "passed":
        return step.get("done_s")
    failed_s: float | None = step.get("failed_s")
    return step.get("begun_s") if failed_s is None else failed_s


def _begun(steps: Sequence[Mapping[str, Any]]) -> dict[int, Mapping[str, Any]]:
    """Return for each expectation the step (`at` or `do`) from which its time is counted.

    The time is `within 10 s` or `for 3 s` in the scenario. The keys are the identities (`id`) of the expectations.
    """
    found: dict[int, Mapping[str, Any]] = {}
    origin: Mapping[str, Any] | None = None
    for step in steps:
        if step.get("kind", "expect") != "expect":
            origin = step if step.get("done_s") is not None else None
        elif origin is not None and step.get("begun_s") == origin.get("done_s"):
            found[id(step)] = origin
    return found
