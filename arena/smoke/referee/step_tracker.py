"""Tracker of one step of a scenario: its trigger, its begin, and its expectations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from arena.smoke.language.model import Step
from arena.smoke.referee.conditions import holds
from arena.smoke.referee.expectation import ExpectationTracker
from arena.smoke.referee.flight_history import FlightHistory
from arena.smoke.referee.verdict import Outcome, StepResult


@dataclass(kw_only=True)
class StepTracker:
    """State of one step of a scenario during its flight. All times are simulation time.

    rose_s: time at which the condition of the trigger last became true [s]; None if never.
    held: true if that condition was true at the last observation.
    begun_s: time at which the step began [s]; None before.
    failure: why an action of the step failed; "" if none failed.
    """

    step: Step
    expectations: list[ExpectationTracker] = field(default_factory=list)
    rose_s: float | None = None
    held: bool = False
    begun_s: float | None = None
    failure: str = ""

    def update(self, flight: FlightHistory) -> None:
        """Check at the newest observation whether the condition of the trigger has become true.

        Call this for every observation, also before the previous step is done, because an earlier trigger counts.
        """
        condition = self.step.trigger.condition if self.step.trigger is not None else None
        if condition is None:
            return
        truth = holds(condition, flight)
        if truth and not self.held:
            self.rose_s = flight.now.time_s
        self.held = self.held if truth is None else truth

    def due_s(self, start_s: float, then_s: float) -> float | None:
        """Return the time at which the step must begin [s], or None if the trigger's condition was never true.

        start_s: time of the first observation [s].  then_s: time at which the previous step was done [s].
        """
        trigger = self.step.trigger
        if trigger is None or trigger.then:
            return then_s + (trigger.after_s if trigger else 0.0)
        since = self.rose_s if trigger.condition is not None else start_s
        return None if since is None else since + trigger.after_s

    def begin(self, now: float) -> None:
        """Begin the step. The times of its expectations count from now.

        now: simulation time [s].
        """
        self.begun_s = now
        self.expectations = [ExpectationTracker(expectation=e, begun_s=now) for e in self.step.expect]

    @property
    def settled(self) -> bool:
        """True if the step has begun and each of its expectations is fulfilled or has failed."""
        return self.begun_s is not None and not any(e.open for e in self.expectations)

    @property
    def failed(self) -> bool:
        """True if an action or an expectation of the step has failed."""
        return bool(self.failure) or any(e.outcome == "failed" for e in self.expectations)

    @property
    def done_s(self) -> float:
        """Time of the last fulfilled expectation [s]; for a step without expectations, the time of its begin."""
        return max((e.done_s for e in self.expectations if e.done_s is not None), default=self.begun_s or 0.0)

    @property
    def results(self) -> Iterator[StepResult]:
        """Yield the result of the trigger and actions of the step, then the result of each expectation."""
        step = self.step
        if step.trigger is not None or step.do or self.failure:
            yield self._own_result()
        if self.begun_s is None:
            yield from (StepResult(place=e.place, outcome="not reached") for e in step.expect)
        else:
            yield from (e.result for e in self.expectations)

    def _own_result(self) -> StepResult:
        kind: Literal["do", "at"] = "do" if self.step.do else "at"
        done = None if self.failure else self.begun_s
        outcome: Outcome = "failed" if self.failure else "not reached" if done is None else "passed"
        return StepResult(
            place=self.step.place,
            kind=kind,
            outcome=outcome,
            begun_s=self.begun_s,
            done_s=done,
            failure=self.failure,
        )
