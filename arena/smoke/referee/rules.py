"""Tracker of one rule of a scenario (key `always`). It checks every observation and records the worst value."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from arena.smoke.language.model import Condition, Rule
from arena.smoke.language.vocabulary import REAL_TIME_FACTOR
from arena.smoke.referee.conditions import (
    OFFBOARD,
    UNKNOWN_LIMIT_S,
    Evaluation,
    evaluate,
    in_words,
    subject,
    unit,
)
from arena.smoke.referee.flight_history import FlightHistory
from arena.smoke.referee.verdict import RuleResult

_FROM_TELEMETRY = frozenset({"battery", "estimate error", "mode", "armed"})
_NEVER_RECEIVED = "the value was never received"
_NOT_RECEIVED = "the value was not received in this time"


@dataclass(kw_only=True)
class _Sum:
    """Sum of squared values, from which the root mean square is computed."""

    squares: float = 0.0
    count: int = 0

    @property
    def rms(self) -> float:
        """Root mean square of the values so far."""
        return math.sqrt(self.squares / self.count)


@dataclass(kw_only=True)
class RuleTracker:
    """Tracker of one rule of a scenario: checks the observations of a flight and keeps the worst value."""

    rule: Rule
    _worst: Evaluation | None = None
    _worst_s: float | None = None
    _sums: dict[str, _Sum] = field(default_factory=dict)
    _received: dict[str, bool] = field(default_factory=dict)
    _known_s: dict[str, float] = field(default_factory=dict)
    _lost_s: dict[str, float] = field(default_factory=dict)
    _modes: dict[str, str] = field(default_factory=dict)

    def update(self, flight: FlightHistory) -> None:
        """Evaluate the rule at the newest observation.

        A rule about vehicles is evaluated for the vehicles in flight only. Other rules are evaluated while at least one
        vehicle is in flight.
        """
        condition, flying = self.rule.condition, flight.in_flight
        self._modes |= {name: vehicle.mode for name, vehicle in flight.now.vehicles.items() if vehicle.mode}
        for evaluation in evaluate(condition, flight) if flying else ():
            if evaluation.who in flying and self._must_be_known(evaluation.who, flight):
                known = self._received.get(evaluation.who, False)
                self._received[evaluation.who] = known or evaluation.holds is not None
                self._note_age(evaluation, flight.now.time_s)
            else:
                self._known_s.pop(evaluation.who, None)
            if evaluation.holds is None or (
                condition.vehicles and condition.kind != "separation" and evaluation.who not in flying
            ):
                continue
            if condition.rms:
                self._sum(evaluation)
            elif (
                condition.kind == REAL_TIME_FACTOR
                or self._worst is None
                or self._is_worse(evaluation, self._worst)
            ):
                self._worst, self._worst_s = evaluation, flight.now.time_s

    def _note_age(self, evaluation: Evaluation, now_s: float) -> None:
        """Record when a value was known last, and for how long it was unknown at most.

        A value that was never known is unknown since the first observation at which it must be known.
        """
        who = evaluation.who
        if evaluation.holds is not None:
            self._known_s[who] = now_s
        else:
            since_s = self._known_s.setdefault(who, now_s)
            self._lost_s[who] = max(self._lost_s.get(who, 0.0), now_s - since_s)

    def _must_be_known(self, who: str, flight: FlightHistory) -> bool:
        """Return whether the autopilot of a vehicle in flight should have sent the value of the rule by now.

        A tracking error exists only in OFFBOARD and in the air. While the mode is unknown, the last known mode counts; a mode that
        was never known counts as OFFBOARD. Quantities from the world are always known.
        """
        if self.rule.condition.kind == "tracking":
            vehicle = flight.now.vehicles.get(who)
            return vehicle is not None and vehicle.airborne and self._modes.get(who, OFFBOARD) == OFFBOARD
        return self.rule.condition.kind in _FROM_TELEMETRY

    def _sum(self, evaluation: Evaluation) -> None:
        kind = self._sums.setdefault(evaluation.who, _Sum())
        kind.squares, kind.count = kind.squares + (evaluation.value or 0.0) ** 2, kind.count + 1

    def _is_worse(self, evaluation: Evaluation, worst: Evaluation) -> bool:
        if evaluation.value is None or worst.value is None:
            return worst.holds is True and evaluation.holds is False
        return (
            evaluation.value > worst.value
            if _wants_less(self.rule.condition)
            else evaluation.value < worst.value
        )

    def result(self, *, complete: bool) -> RuleResult:
        """Return the result of the rule for the report: whether it was met, and the worst value.

        complete: all steps were carried out. Then a rule that was never evaluated has failed; else it was not reached.
        """
        condition = self.rule.condition
        worst = self._rms() if condition.rms else self._worst
        if worst is None:
            failure = f"the rule could not be evaluated: {_never(condition)}" if complete else ""
            return RuleResult(
                place=self.rule.place, outcome="failed" if complete else "not reached", failure=failure
            )
        unknown = sorted(who for who, received in self._received.items() if not received)
        if complete and unknown and worst.holds is not False:
            failure = f"the rule could not be evaluated for {', '.join(unknown)}: {_NEVER_RECEIVED}"
            return RuleResult(place=self.rule.place, outcome="failed", failure=failure)
        lost = {who: s for who, s in self._lost_s.items() if s > UNKNOWN_LIMIT_S}
        if complete and lost and worst.holds is not False:
            spans = ", ".join(f"{who} for {s:.1f} s" for who, s in sorted(lost.items()))
            failure = f"the rule could not be evaluated for {spans}: {_NOT_RECEIVED}"
            return RuleResult(place=self.rule.place, outcome="failed", failure=failure)
        shown, si = unit(condition) if worst.value is not None else ("", 1.0)
        return RuleResult(
            place=self.rule.place,
            outcome="failed" if worst.holds is False else "passed",
            worst=None if worst.value is None else worst.value / si,
            unit=shown,
            at_s=self._worst_s,
            who=worst.who,
            failure=self._failure(worst) if worst.holds is False else "",
        )

    def _rms(self) -> Evaluation | None:
        condition = self.rule.condition
        values = {who: kind.rms for who, kind in self._sums.items()}
        if not values:
            return None
        who = (max if _wants_less(condition) else min)(values, key=lambda name: values[name])
        held = (
            (values[who] < condition.value) if condition.operator == "<" else (values[who] > condition.value)
        )
        return Evaluation(who=who, holds=held != condition.negated, value=values[who])

    def _failure(self, worst: Evaluation) -> str:
        condition = self.rule.condition
        when = "" if self._worst_s is None else f" at {self._worst_s:.2f} s"
        if worst.value is None:
            return f"{subject(condition, worst.who)} was {worst.text or 'unknown'}{when}; expected {condition.place.text}"
        if condition.kind == "outside" and condition.value == 0.0 and worst.value > 0.0:
            return f"{worst.who} was {in_words(condition, worst.value)} outside the geofence{when}"
        rms, more = " rms over its flight in OFFBOARD" if condition.rms else "", _wants_less(condition)
        limit = f"expected {'less' if more else 'more'} than {in_words(condition, condition.value)}"
        return f"{subject(condition, worst.who)} was {in_words(condition, worst.value)}{rms}{when}; {limit}"


def _wants_less(condition: Condition) -> bool:
    return (condition.operator == "<") != condition.negated


def _never(condition: Condition) -> str:
    if condition.kind == "tracking":
        return "no position setpoint was received in OFFBOARD and in the air"
    if condition.kind == REAL_TIME_FACTOR:
        return "the flight was shorter than 1 s"
    return f"no vehicle took off, or {_NEVER_RECEIVED}"
