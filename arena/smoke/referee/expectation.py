"""An expectation: looked at from a moment on, until it is fulfilled or has failed, with what was seen meanwhile."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from arena.smoke.language.model import Condition, Expectation
from arena.smoke.referee.conditions import Seen, holds, in_words, look, subject
from arena.smoke.referee.flight_history import Flight
from arena.smoke.referee.verdict import StepResult

EPSILON_S = 1e-6
_MOST = 4


@dataclass(kw_only=True)
class _Story:
    """What one thing was like, look after look."""

    words: list[str] = field(default_factory=list)
    low: float | None = None
    high: float | None = None
    holds: bool | None = None

    def see(self, seen: Seen) -> None:
        self.holds = seen.holds
        if seen.value is not None:
            self.low = seen.value if self.low is None else min(self.low, seen.value)
            self.high = seen.value if self.high is None else max(self.high, seen.value)
        if seen.words and self.words[-1:] != [seen.words]:
            self.words.append(seen.words)

    def tell(self, condition: Condition) -> str:
        if self.low is not None and self.high is not None:
            low, high = in_words(condition, self.low), in_words(condition, self.high)
            return f"was {low} all the time" if low == high else f"was between {low} and {high}"
        if not self.words:
            return "was not heard"
        if len(self.words) == 1:
            return f"was {self.words[0]} all the time"
        few = self.words if len(self.words) <= _MOST else [self.words[0], "...", *self.words[-2:]]
        return f"was {', then '.join(few)}"


@dataclass(kw_only=True)
class ExpectationTracker:
    """One expectation, counted from begun_s [s]."""

    expectation: Expectation
    begun_s: float
    state: Literal["open", "fulfilled", "failed"] = "open"
    done_s: float | None = None
    failure: str = ""
    _known: bool = False
    _stories: dict[str, _Story] = field(default_factory=dict)

    def see(self, flight: Flight) -> None:
        """Every look after the one at begun_s, while it is open."""
        if self.state != "open":
            return
        if (
            self.expectation.within_s is not None
            and flight.now.time_s > self.begun_s + self.expectation.within_s + EPSILON_S
        ):
            self.fail(self._told())
            return
        for seen in look(self.expectation.condition, flight):
            self._stories.setdefault(seen.who, _Story()).see(seen)
        truth, passed = holds(self.expectation.condition, flight), flight.now.time_s - self.begun_s
        self._known = self._known or truth is not None
        if self.expectation.for_s is not None:
            self._for(self.expectation.for_s, truth, passed)
        elif truth:
            self._fulfil(passed)

    def _for(self, limit: float, truth: bool | None, passed: float) -> None:
        if truth is False and passed <= limit + EPSILON_S:
            self.fail(f"{self._told()} (not so any more after {passed:.2f} s)")
        elif passed >= limit - EPSILON_S:
            if self._known:
                self._fulfil(passed)
            else:
                self.fail(self._told())

    def cut(self, flight: Flight, why: str) -> None:
        """No look will follow."""
        if (
            self.state == "open"
            and holds(self.expectation.condition, flight)
            and self.expectation.within_s is not None
        ):
            self._fulfil(flight.now.time_s - self.begun_s)
        elif self.state == "open":
            self.fail(
                f"{self._told()}; {why} {flight.now.time_s - self.begun_s:.2f} s after it began to count"
            )

    def _fulfil(self, passed: float) -> None:
        self.state, self.done_s = "fulfilled", self.begun_s + passed

    def fail(self, failure: str) -> None:
        self.state, self.failure = "failed", failure

    def _told(self) -> str:
        """What was seen of those that do not hold, and what was expected."""
        condition = self.expectation.condition
        wrong = {
            who: story for who, story in self._stories.items() if story.holds is not True
        } or self._stories
        told = [
            f"{subject(condition, who)} {story.tell(condition)}" for who, story in list(wrong.items())[:_MOST]
        ]
        more = f", and {len(wrong) - _MOST} more" if len(wrong) > _MOST else ""
        return f"{', '.join(told) or 'nothing was seen'}{more}; expected {self.expectation.place.text}"

    @property
    def result(self) -> StepResult:
        return StepResult(
            place=self.expectation.place,
            outcome="passed"
            if self.state == "fulfilled"
            else "failed"
            if self.state == "failed"
            else "not reached",
            kind="expect",
            begun_s=self.begun_s,
            done_s=self.done_s,
            failure=self.failure,
        )
