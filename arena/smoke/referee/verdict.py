"""Dataclasses for the result of a scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from arena.smoke.language.model import Place

Outcome = Literal["passed", "failed", "not reached"]


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """Result of a trigger, of a step's actions, or of an expectation. Times are simulation time.

    begun_s: time of the trigger, or time from which the expectation counts [s].
    done_s: time at which the actions were carried out or the expectation was fulfilled [s]; None if never.
    failed_s: time at which the expectation failed, for example at the end of its `within` [s]; None if it did not fail.
    failure: text with the observed values; "" if not failed.
    """

    place: Place
    outcome: Outcome
    kind: Literal["at", "do", "expect"] = "expect"
    begun_s: float | None = None
    done_s: float | None = None
    failed_s: float | None = None
    failure: str = ""

    @property
    def took_s(self) -> float | None:
        """Duration of the step from `begun_s` to `done_s` [s], or None if the step was not completed."""
        return None if self.begun_s is None or self.done_s is None else self.done_s - self.begun_s


@dataclass(frozen=True, kw_only=True)
class RuleResult:
    """Result of a rule of `always`, or of a default rule such as "no vehicle crashes".

    worst: observed value that was closest to the limit, or farthest beyond the limit, in `unit`; None if not measured.
    at_s: simulation time of that value [s].
    who: vehicle, pair of vehicles or process with that value.
    """

    place: Place
    outcome: Outcome
    worst: float | None = None
    unit: str = ""
    at_s: float | None = None
    who: str = ""
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class Touchdown:
    """The last touchdown of one vehicle.

    at_s: simulation time [s].
    after_s: time since the last action of the scenario [s], None if there was no action.
    speed_m_s: speed at the last observation in the air [m/s].
    drift_m: horizontal distance from the position at the last action [m], None if there was no action.
    """

    vehicle: str
    at_s: float
    after_s: float | None
    speed_m_s: float
    drift_m: float | None


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Verdict on one flight: the results of its steps and rules.

    lasted_s: simulation time from the first to the last observation [s].
    ended: reason why the flight ended.
    problems: failures that belong to no step or rule, such as an arena that did not start.
    """

    steps: tuple[StepResult, ...]
    rules: tuple[RuleResult, ...]
    touchdowns: tuple[Touchdown, ...] = ()
    lasted_s: float = 0.0
    ended: str = ""
    problems: tuple[str, ...] = ()

    @property
    def failures(self) -> tuple[tuple[Place | None, str], ...]:
        """All failures, as pairs (place in the scenario file, text).

        The place is None for the entries of `problems`, which belong to no line of the file.
        """
        judged: Sequence[StepResult | RuleResult] = (*self.steps, *self.rules)
        return (
            *((r.place, r.failure) for r in judged if r.outcome == "failed"),
            *((None, t) for t in self.problems),
        )

    @property
    def passed(self) -> bool:
        """True if there is no failure and every step has passed."""
        return not self.failures and all(s.outcome == "passed" for s in self.steps)


@dataclass(frozen=True, kw_only=True)
class Result:
    """Result of the flight of one scenario.

    run: path of the run folder, "" if there is none.  wall_s: duration in wall time [s].
    about: one sentence about what the scenario tests, "" if its file has none.
    report: path of report.html, "" if there is none.  facts: properties of the arena, such as its autopilot, for the report.
    """

    scenario: str
    file: str
    seed: int
    verdict: Verdict
    run: str = ""
    wall_s: float = 0.0
    about: str = ""
    report: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
