"""A rule of `always`: judged at every look, told by its worst value."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from arena.smoke.language.model import Condition, Rule
from arena.smoke.referee.conditions import Seen, in_words, look, subject, unit
from arena.smoke.referee.flight_history import Flight
from arena.smoke.referee.verdict import RuleResult


@dataclass(kw_only=True)
class _Sum:
    squares: float = 0.0
    count: int = 0

    @property
    def rms(self) -> float:
        return math.sqrt(self.squares / self.count)


@dataclass(kw_only=True)
class Watch:
    """One rule over a flight."""

    rule: Rule
    _worst: Seen | None = None
    _worst_s: float | None = None
    _sums: dict[str, _Sum] = field(default_factory=dict)

    def see(self, flight: Flight) -> None:
        """Of vehicles, those in flight; of anything else, while anybody is."""
        condition, flying = self.rule.condition, flight.in_flight
        for seen in look(condition, flight) if flying else ():
            if seen.holds is None or (
                condition.vehicles and condition.of != "separation" and seen.who not in flying
            ):
                continue
            if condition.rms:
                self._sum(seen)
            elif self._worst is None or self._is_worse(seen, self._worst):
                self._worst, self._worst_s = seen, flight.now.time_s

    def _sum(self, seen: Seen) -> None:
        of = self._sums.setdefault(seen.who, _Sum())
        of.squares, of.count = of.squares + (seen.value or 0.0) ** 2, of.count + 1

    def _is_worse(self, seen: Seen, worst: Seen) -> bool:
        if seen.value is None or worst.value is None:
            return worst.holds is True and seen.holds is False
        return seen.value > worst.value if _wants_less(self.rule.condition) else seen.value < worst.value

    def result(self, *, complete: bool) -> RuleResult:
        """complete: the flight went as the scenario says, so there must have been something to judge."""
        condition = self.rule.condition
        worst = self._rms() if condition.rms else self._worst
        if worst is None:
            said = f"nothing was seen to judge it by: {_never(condition)}" if complete else ""
            return RuleResult(
                place=self.rule.place, outcome="failed" if complete else "not reached", failure=said
            )
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

    def _rms(self) -> Seen | None:
        condition = self.rule.condition
        values = {who: of.rms for who, of in self._sums.items()}
        if not values:
            return None
        who = (max if _wants_less(condition) else min)(values, key=lambda name: values[name])
        held = (values[who] < condition.value) if condition.sign == "<" else (values[who] > condition.value)
        return Seen(who=who, holds=held != condition.negated, value=values[who])

    def _failure(self, worst: Seen) -> str:
        condition = self.rule.condition
        when = "" if self._worst_s is None else f" at {self._worst_s:.2f} s"
        if worst.value is None:
            return f"{subject(condition, worst.who)} was {worst.words or 'not heard'}{when}; asked is {condition.place.text}"
        if condition.of == "outside" and condition.value == 0.0 and worst.value > 0.0:
            return f"{worst.who} was {in_words(condition, worst.value)} outside the geofence{when}"
        rms, more = " rms over its flight in OFFBOARD" if condition.rms else "", _wants_less(condition)
        asked = f"{'less' if more else 'more'} than {in_words(condition, condition.value)} is asked"
        return f"{subject(condition, worst.who)} was {in_words(condition, worst.value)}{rms}{when}; {asked}"


def _wants_less(condition: Condition) -> bool:
    return (condition.sign == "<") != condition.negated


def _never(condition: Condition) -> str:
    if condition.of == "tracking":
        return "no setpoint of a position was heard in OFFBOARD and in the air"
    return "nobody took off, or it was never heard"
