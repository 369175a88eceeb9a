"""Tracker of one expectation of a scenario. It records the observed values until success or failure."""

from __future__ import annotations

from dataclasses import dataclass, field

from arena.smoke.language.model import Condition, Expectation
from arena.smoke.referee.conditions import (
    UNKNOWN_LIMIT_S,
    Evaluation,
    evaluate,
    holds,
    in_words,
    subject,
)
from arena.smoke.referee.flight_history import FlightHistory
from arena.smoke.referee.verdict import Outcome, StepResult

EPSILON_S = 1e-6
_MAX_LISTED = 4


@dataclass(kw_only=True)
class _Record:
    """Values observed for one vehicle or process: lowest and highest number, or the sequence of texts."""

    texts: list[str] = field(default_factory=list)
    low: float | None = None
    high: float | None = None
    holds: bool | None = None

    def update(self, evaluation: Evaluation) -> None:
        self.holds = evaluation.holds
        if evaluation.value is not None:
            self.low = evaluation.value if self.low is None else min(self.low, evaluation.value)
            self.high = evaluation.value if self.high is None else max(self.high, evaluation.value)
        if evaluation.text and self.texts[-1:] != [evaluation.text]:
            self.texts.append(evaluation.text)

    def describe(self, condition: Condition) -> str:
        """Return a text such as `was between 0.00 m and 1.00 m` or `was OFFBOARD, then AUTO.LAND`."""
        if self.low is not None and self.high is not None:
            low, high = in_words(condition, self.low), in_words(condition, self.high)
            return f"was {low} all the time" if low == high else f"was between {low} and {high}"
        if not self.texts:
            return "was unknown"
        if len(self.texts) == 1:
            return f"was {self.texts[0]} all the time"
        few = self.texts if len(self.texts) <= _MAX_LISTED else [self.texts[0], "...", *self.texts[-2:]]
        return f"was {', then '.join(few)}"


@dataclass(kw_only=True)
class ExpectationTracker:
    """State of one expectation of a scenario: open, fulfilled or failed, with the values observed so far.

    begun_s: simulation time from which the time of the expectation counts [s].
    done_s: simulation time at which the expectation was fulfilled [s].  failed_s: simulation time at which it failed [s].
    failure: why it failed, with the observed values.
    """

    expectation: Expectation
    begun_s: float
    outcome: Outcome = "not reached"
    done_s: float | None = None
    failed_s: float | None = None
    failure: str = ""
    _known_at: float | None = None
    _records: dict[str, _Record] = field(default_factory=dict)

    @property
    def open(self) -> bool:
        """True while the expectation is neither fulfilled nor failed."""
        return self.outcome == "not reached"

    def update(self, flight: FlightHistory) -> None:
        """Evaluate the expectation at the newest observation. Call this for every observation after `begun_s`."""
        if not self.open:
            return
        passed = flight.now.time_s - self.begun_s
        if self.expectation.within_s is not None and passed > self.expectation.within_s + EPSILON_S:
            self._fail(passed, self._describe())
            return
        for evaluation in evaluate(self.expectation.condition, flight):
            self._records.setdefault(evaluation.who, _Record()).update(evaluation)
        truth = holds(self.expectation.condition, flight)
        if self.expectation.for_s is not None:
            self._update_for(self.expectation.for_s, truth, passed)
        elif truth:
            self._fulfil(passed)

    def _update_for(self, limit: float, truth: bool | None, passed: float) -> None:
        if truth is not None:
            self._known_at = passed
        elif passed - (self._known_at or 0.0) > UNKNOWN_LIMIT_S + EPSILON_S:
            self._fail(passed, f"{self._describe()} (unknown for more than {UNKNOWN_LIMIT_S:g} s)")
            return
        if truth is False and passed <= limit + EPSILON_S:
            self._fail(passed, f"{self._describe()} (failed after {passed:.2f} s)")
        elif passed >= limit - EPSILON_S:
            if self._known_at is not None:
                self._fulfil(passed)
            else:
                self._fail(passed, self._describe())

    def close(self, flight: FlightHistory, why: str) -> None:
        """Decide an open expectation at the end of the flight: fulfilled or failed.

        why: text about the end of the flight.
        """
        if not self.open:
            return
        passed = flight.now.time_s - self.begun_s
        if self.expectation.within_s is not None and holds(self.expectation.condition, flight):
            self._fulfil(passed)
        else:
            self._fail(passed, f"{self._describe()}; {why} after {passed:.2f} s")

    def _fulfil(self, passed: float) -> None:
        self.outcome, self.done_s = "passed", self.begun_s + passed

    def _fail(self, passed: float, failure: str) -> None:
        self.outcome, self.failed_s, self.failure = "failed", self.begun_s + passed, failure

    def _describe(self) -> str:
        """Return the failure as text: the expectation, and the values observed for each failed vehicle or process."""
        condition, records = self.expectation.condition, self._records
        wrong = {who: record for who, record in records.items() if record.holds is not True} or records
        found = [
            f"{subject(condition, who)} {record.describe(condition)}"
            for who, record in list(wrong.items())[:_MAX_LISTED]
        ]
        more = f", and {len(wrong) - _MAX_LISTED} more" if len(wrong) > _MAX_LISTED else ""
        return f"{', '.join(found) or 'nothing was observed'}{more}; expected {self.expectation.place.text}"

    @property
    def result(self) -> StepResult:
        """Result of the expectation, for the report."""
        return StepResult(
            place=self.expectation.place,
            outcome=self.outcome,
            kind="expect",
            begun_s=self.begun_s,
            done_s=self.done_s,
            failed_s=self.failed_s,
            failure=self.failure,
        )
