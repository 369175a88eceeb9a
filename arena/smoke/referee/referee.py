"""The referee: looks at a flight fifty times a second of its own time, says what is to be done when, and judges. Pure.

    referee = Referee(scenario)
    while not referee.over:
        for deed in referee.look(now):      # those due at this instant, `undo` ones among them
            try: carry it out
            except ArenaError as error: referee.refused(deed, str(error))
    referee.finish(outcome)                 # when the arena has ended, whatever ended it
    result = referee.verdict()

The same looks give the same verdict: nothing here knows of wall time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from arena.plan.make import process_names
from arena.smoke.language.model import Deed, Moment, Now, Place, Step
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.conditions import holds
from arena.smoke.referee.expectation import EPSILON_S, ExpectationTracker
from arena.smoke.referee.flight_history import Flight
from arena.smoke.referee.rules import Watch
from arena.smoke.referee.verdict import Outcome, Row, RuleResult, StepResult, Verdict

_HIT = ("kill", "hang", "restart")
_LANDED, _CRASH, _PROCESSES = "everybody has landed at the end", "nobody crashes", "no process fails"
_DONE, _FAILED, _LIMIT, _GONE = "all is done", "a step failed", "the time limit", "the end of the arena"


@dataclass(kw_only=True)
class _Act:
    """A step on its way. rose_s: when its moment's condition became true last [s]; begun_s: when it was its turn [s]."""

    step: Step
    hopes: list[ExpectationTracker] = field(default_factory=list)
    rose_s: float | None = None
    held: bool = False
    begun_s: float | None = None
    failure: str = ""

    def watch(self, flight: Flight) -> None:
        """At every look of the flight, so that a moment that came before its turn is not missed."""
        condition = self.step.moment.condition if self.step.moment is not None else None
        if condition is None:
            return
        truth = holds(condition, flight)
        if truth and not self.held:
            self.rose_s = flight.now.time_s
        self.held = self.held if truth is None else truth

    def due_s(self, start_s: float, then_s: float) -> float | None:
        """When it is to begin [s]; None: not known yet. then_s: when the step before was done."""
        moment = self.step.moment
        if moment is None or moment.then:
            return then_s + (moment.after_s if moment else 0.0)
        since = self.rose_s if moment.condition is not None else start_s
        return None if since is None else since + moment.after_s

    @property
    def settled(self) -> bool:
        return self.begun_s is not None and all(hope.state != "open" for hope in self.hopes)

    @property
    def failed(self) -> bool:
        return bool(self.failure) or any(hope.state == "failed" for hope in self.hopes)

    @property
    def done_s(self) -> float:
        return max(
            (hope.done_s for hope in self.hopes if hope.done_s is not None), default=self.begun_s or 0.0
        )

    @property
    def results(self) -> Iterator[StepResult]:
        step = self.step
        if step.moment is not None or step.do or self.failure:
            kind: Literal["do", "at"] = "do" if step.do else "at"
            done = None if self.failure else self.begun_s
            outcome: Outcome = "failed" if self.failure else "not reached" if done is None else "passed"
            yield StepResult(
                place=step.place,
                kind=kind,
                outcome=outcome,
                begun_s=self.begun_s,
                done_s=done,
                failure=self.failure,
            )
        if self.begun_s is None:
            yield from (StepResult(place=e.place, outcome="not reached") for e in step.expect)
        else:
            yield from (hope.result for hope in self.hopes)


class Referee:
    """Of one flight."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._flight = Flight(vehicles=tuple(v.name for v in scenario.arena.vehicles), fence=scenario.fence)
        self._acts = [_Act(step=step) for step in scenario.steps]
        self._rules = [Watch(rule=rule) for rule in scenario.always]
        self._undo: list[tuple[float, Deed]] = []
        self._hit: set[str] = set()
        self._fatal: dict[str, str] = {}
        self._start_s: float | None = None
        self._then_s = 0.0
        self._over = ""
        self._troubles: list[str] = []

    # -- while it flies

    def look(self, now: Now) -> list[Deed]:
        """The deeds due at this instant, in order; a look must not be earlier than the one before."""
        if self._start_s is None:
            self._start_s = self._then_s = now.time_s
        self._flight.see(now)
        self._fatal |= {name: "is FATAL" for name, state in now.processes.items() if state == "FATAL"}
        for act in self._acts:
            act.watch(self._flight)
        for watch in self._rules:
            watch.see(self._flight)
        self._judge()
        deeds = self._taken_back(now.time_s) + self._begin(now.time_s)
        self._end(now.time_s)
        return deeds

    def refused(self, deed: Deed, why: str) -> None:
        """This deed of the last look could not be carried out: its step has failed."""
        said = f"could not be {'taken back' if deed.undo else 'done'}: {why}"
        self._hit -= set(deed.processes)
        for act in self._acts:
            if replace(deed, undo=False) in act.step.do:
                act.failure = f"{deed.place.text} {said}"
                self._over = self._over or _FAILED
                return
        self._troubles.append(f"{deed.place.text} {said}")

    @property
    def over(self) -> bool:
        """Nothing more is to be seen: all steps done and all vehicles down, or one failed, or the time limit has come."""
        return bool(self._over)

    @property
    def why_over(self) -> str:
        """In words; "" while it is not."""
        return self._over

    @property
    def rows(self) -> Sequence[Row]:
        """For pictures: every vehicle at ten looks a second of simulation time."""
        return self._flight.rows

    @property
    def _current(self) -> _Act | None:
        """The first that is not done."""
        return next((act for act in self._acts if not act.settled or act.failed), None)

    def _judge(self) -> None:
        act = self._current
        if act is not None and act.begun_s is not None and not act.settled:
            for hope in act.hopes:
                hope.see(self._flight)
            if act.settled:
                self._then_s = act.done_s

    def _begin(self, now: float) -> list[Deed]:
        """Every step whose turn and moment have come."""
        deeds: list[Deed] = []
        while (act := self._current) is not None and act.begun_s is None:
            due = act.due_s(self._start_s or 0.0, self._then_s)
            if due is None or due > now + EPSILON_S:
                break
            act.begun_s = self._then_s = now
            act.hopes = [
                ExpectationTracker(expectation=expectation, begun_s=now) for expectation in act.step.expect
            ]
            deeds += act.step.do
            self._undo += [
                (now + deed.for_s, replace(deed, undo=True)) for deed in act.step.do if deed.for_s is not None
            ]
            self._hit |= {name for deed in act.step.do if deed.verb in _HIT for name in deed.processes}
            if act.step.do:
                self._flight.deed()
        return deeds

    def _taken_back(self, now: float) -> list[Deed]:
        due = [deed for at, deed in self._undo if at <= now + EPSILON_S]
        self._undo = [(at, deed) for at, deed in self._undo if at > now + EPSILON_S]
        return due

    def _end(self, now: float) -> None:
        act, limit = self._current, self._scenario.time_limit_s
        if act is not None and act.failed and act.settled:
            self._over = self._over or _FAILED
        elif act is None and (self._scenario.allowed.stay_up or not self._flight.still_up):
            self._over = self._over or _DONE
        elif now - (self._start_s or 0.0) >= limit - EPSILON_S:
            self._over = self._over or f"{_LIMIT} of {limit:g} s"

    # -- when it has ended

    def finish(self, outcome: Mapping[str, Any], trouble: str = "") -> None:
        """The arena has ended. outcome: its outcome.json, {} where there is none. trouble: what else went wrong, in words, such
        as an arena that did not come up, or a world that no longer moved: it fails the scenario.
        """
        self._flight.ended = not self._over  # an arena that was taken down since has not ended by itself
        self._over = self._over or _GONE
        self._troubles += [trouble] if trouble else []
        for sentence in outcome.get("failed", ()):
            self._failed(str(sentence))
        self._cut()

    def _failed(self, sentence: str) -> None:
        """One of the supervisor's sentences on what made the run a failed one. A landing it could not confirm was seen here."""
        process, _, why = sentence.partition(": ")
        vehicle = process.partition(" crashed")[0]
        if vehicle in self._flight.vehicles and vehicle != process:
            self._flight.crashes.setdefault(vehicle, why)
        elif process in process_names(self._scenario.arena) or process in self._hit:
            self._fatal[process] = why
        elif "landing was not confirmed" not in sentence:
            self._troubles.append(sentence)

    def _cut(self) -> None:
        """What is still open will not be seen. A step that waits for the end of the arena has its moment now."""
        while (act := self._current) is not None and not act.failed:
            now = self._flight.now.time_s
            act.watch(self._flight)
            due = act.due_s(self._start_s or 0.0, self._then_s)
            if act.begun_s is None and not (due is not None and due <= now and not act.step.do):
                act.failure = (
                    f"{_waited(act.step.moment)} never came: {self._over} came first, at {now:.2f} s"
                )
                return
            if act.begun_s is None:
                act.begun_s = now
                act.hopes = [
                    ExpectationTracker(expectation=expectation, begun_s=now)
                    for expectation in act.step.expect
                ]
            for hope in act.hopes:
                hope.cut(self._flight, f"{self._over} came")
            self._then_s = act.done_s

    # -- the verdict

    def verdict(self) -> Verdict:
        """After `finish`."""
        complete = self._current is None and not self._troubles
        now, start = self._flight.now.time_s, self._start_s
        return Verdict(
            steps=tuple(result for act in self._acts for result in act.results),
            rules=(
                *(watch.result(complete=complete) for watch in self._rules),
                *self._defaults(complete=complete),
            ),
            touchdowns=self._flight.touchdowns,
            lasted_s=0.0 if start is None else now - start,
            ended=self._over,
            troubles=tuple(self._troubles),
        )

    def _defaults(self, *, complete: bool) -> Iterator[RuleResult]:
        """What holds though nobody wrote it."""
        allowed = self._scenario.allowed
        yield self._default(
            _CRASH,
            [f"{v} crashed: {why}" for v, why in self._flight.crashes.items() if v not in allowed.crash],
        )
        if not allowed.stay_up:
            up = self._flight.still_up if complete else ()
            seen = [f"{v} {self._where(v)}, {self._over} came at {self._flight.now.time_s:.2f} s" for v in up]
            yield self._default(_LANDED, seen, reached=complete)
        excused = self._hit | allowed.fail
        yield self._default(_PROCESSES, [_fate(p, why) for p, why in self._fatal.items() if p not in excused])

    def _default(self, text: str, failures: list[str], *, reached: bool = True) -> RuleResult:
        place = Place(file=self._scenario.place.file, line=self._scenario.place.line, text=text)
        outcome: Outcome = "failed" if failures else "passed" if reached else "not reached"
        return RuleResult(place=place, outcome=outcome, failure="; ".join(failures))

    def _where(self, name: str) -> str:
        vehicle = self._flight.now.vehicles.get(name)
        if vehicle is None:
            return "was not seen any more"
        if vehicle.airborne:
            return f"was in the air in {vehicle.mode or 'an unknown mode'}, {vehicle.height_m:.2f} m above the floor"
        return "was on the floor and " + ("not heard of" if vehicle.armed is None else "still armed")


def _fate(process: str, why: str) -> str:
    return f"{process}: {why} (where that is meant, write `may: [fail {process}]`)"


def _waited(moment: Moment | None) -> str:
    return "its turn" if moment is None else moment.place.text
