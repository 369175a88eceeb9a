"""The referee: receives observations of a flight, returns actions, and decides whether it passed. Pure.

    referee = Referee(scenario)
    while not referee.over:                          # 50 times per simulated second
        for action in referee.observe(observation):  # actions to carry out or to undo now
            try: carry it out
            except ArenaError as error: referee.action_failed(action, str(error))
    referee.finish(outcome)                          # after the arena has ended, for any reason
    verdict = referee.verdict()

The same observations give the same verdict. Only the rule `real time factor` depends on wall time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from arena.plan.make import process_names
from arena.smoke.language.model import Action, Observation, Place, Trigger
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.expectation import EPSILON_S
from arena.smoke.referee.flight_history import FlightHistory
from arena.smoke.referee.rules import RuleTracker
from arena.smoke.referee.step_tracker import StepTracker
from arena.smoke.referee.verdict import Outcome, RuleResult, Verdict

_ENDING_VERBS = ("kill", "hang", "restart")
_LANDED, _CRASH, _PROCESSES = "all vehicles have landed at the end", "no vehicle crashes", "no process fails"
_DONE, _FAILED, _LIMIT, _GONE = (
    "all steps are done",
    "a step failed",
    "the time limit",
    "the end of the arena",
)
_SUPERVISOR = "supervisor"
_NO_OUTCOME = "the run has no outcome: its supervisor has ended without a result"


class Referee:
    """Referee of one flight. It follows the steps and rules of a scenario and gives the verdict."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._flight = FlightHistory(
            vehicles=tuple(v.name for v in scenario.arena.vehicles), fence=scenario.fence
        )
        self._steps = [StepTracker(step=step) for step in scenario.steps]
        self._rules = [RuleTracker(rule=rule) for rule in scenario.always]
        self._undo: list[tuple[float, Action]] = []
        self._targeted: set[str] = set()
        self._failed_processes: dict[str, str] = {}
        self._start_s: float | None = None
        self._then_s = 0.0
        self._end_reason = ""
        self._problems: list[str] = []
        self._has_outcome = True

    # -- during the flight

    def observe(self, now: Observation) -> list[Action]:
        """Evaluate the next observation and return the actions to carry out now, in order.

        now: observation, not earlier than the previous one.
        """
        if self._start_s is None:
            self._start_s = self._then_s = now.time_s
        self._flight.update(now)
        self._failed_processes |= {
            name: "is FATAL" for name, state in now.processes.items() if state == "FATAL"
        }
        for step in self._steps:
            step.update(self._flight)
        for rule in self._rules:
            rule.update(self._flight)
        self._update_expectations()
        actions = self._due_undos(now.time_s) + self._begin_steps(now.time_s)
        self._check_end(now.time_s)
        return actions

    def action_failed(self, action: Action, why: str) -> None:
        """Mark the step of an action as failed, because the action could not be carried out.

        why: the error.
        """
        failure = f"{action.place.text} could not be {'undone' if action.undo else 'done'}: {why}"
        self._targeted -= set(action.processes)
        for step in self._steps:
            if replace(action, undo=False) in step.step.do:
                step.failure = failure
                self._end_reason = self._end_reason or _FAILED
                return
        self._problems.append(failure)

    @property
    def over(self) -> bool:
        """True if the flight is over.

        The flight is over if all steps are done and all vehicles are down, a step failed, or the time limit passed.
        """
        return bool(self._end_reason)

    @property
    def _current(self) -> StepTracker | None:
        """First step that has not passed: failed, not complete, or not begun. None if all steps have passed."""
        return next((step for step in self._steps if not step.settled or step.failed), None)

    def _update_expectations(self) -> None:
        step = self._current
        if step is not None and step.begun_s is not None and not step.settled:
            for expectation in step.expectations:
                expectation.update(self._flight)
            if step.settled:
                self._then_s = step.done_s

    def _begin_steps(self, now: float) -> list[Action]:
        """Begin all steps whose trigger time has come, in order from the current step.

        Returns the actions of these steps.
        """
        actions: list[Action] = []
        while (step := self._current) is not None and step.begun_s is None:
            due = step.due_s(self._start_s or 0.0, self._then_s)
            if due is None or due > now + EPSILON_S:
                break
            step.begin(now)
            self._then_s = now
            actions += step.step.do
            for action in step.step.do:
                if action.for_s is not None:
                    self._undo.append((now + action.for_s, replace(action, undo=True)))
                if action.verb in _ENDING_VERBS:
                    self._targeted |= set(action.processes)
            if step.step.do:
                self._flight.action()
        return actions

    def _due_undos(self, now: float) -> list[Action]:
        due = [action for at, action in self._undo if at <= now + EPSILON_S]
        self._undo = [(at, action) for at, action in self._undo if at > now + EPSILON_S]
        return due

    def _check_end(self, now: float) -> None:
        step, limit = self._current, self._scenario.time_limit_s
        if step is not None and step.failed and step.settled:
            self._end_reason = self._end_reason or _FAILED
        elif step is None and (self._scenario.allowed.stay_up or not self._flight.still_up):
            self._end_reason = self._end_reason or _DONE
        elif now - (self._start_s or 0.0) >= limit - EPSILON_S:
            self._end_reason = self._end_reason or f"{_LIMIT} of {limit:g} s"

    # -- after the flight

    def finish(self, outcome: Mapping[str, Any] | None, problem: str = "") -> None:
        """Add the end of the arena to the verdict: reported failures, and steps that are still open.

        Call it once.

        outcome: content of outcome.json; None if the file is missing, which fails a scenario that did not kill its supervisor.
        problem: text of another failure, such as an arena that did not start, which fails the scenario; "" if none.
        """
        self._flight.ended = (
            not self._end_reason
        )  # true only if the arena ended before the referee ended the flight
        self._end_reason = self._end_reason or _GONE
        self._problems += [problem] if problem else []
        if outcome is None and _SUPERVISOR not in self._targeted | self._scenario.allowed.fail:
            self._has_outcome = False  # the failures of the processes are unknown
            self._problems += [] if problem else [_NO_OUTCOME]
        for sentence in (outcome or {}).get("failed", ()):
            self._take_failure(str(sentence))
        self._close_remaining()

    def _take_failure(self, sentence: str) -> None:
        """Record a failure that the supervisor wrote to outcome.json (key `failed`).

        The failure is recorded as a crash of a vehicle, an error of a process, or a problem of the whole flight.
        """
        process, _, why = sentence.partition(": ")
        vehicle = process.partition(" crashed")[0]
        if vehicle in self._flight.vehicles and vehicle != process:
            self._flight.crashes.setdefault(vehicle, why)
        elif process in process_names(self._scenario.arena) or process in self._targeted:
            self._failed_processes[process] = why
        elif (
            "landing was not confirmed" not in sentence
        ):  # the referee itself checks whether the vehicles have landed
            self._problems.append(sentence)

    def _close_remaining(self) -> None:
        """Decide for each step that is still open at the end of the arena: passed or failed.

        A step that is triggered by the end of the arena begins now.
        """
        while (step := self._current) is not None and not step.failed:
            now = self._flight.now.time_s
            step.update(self._flight)
            due = step.due_s(self._start_s or 0.0, self._then_s)
            if step.begun_s is None and not (due is not None and due <= now and not step.step.do):
                step.failure = f"{_waited_for(step.step.trigger)} never came: {self._end_reason} came first, at {now:.2f} s"
                return
            if step.begun_s is None:
                step.begin(now)
            for expectation in step.expectations:
                expectation.close(self._flight, f"{self._end_reason} came")
            self._then_s = step.done_s

    # -- the verdict

    def verdict(self) -> Verdict:
        """Return the verdict. Call it after `finish`."""
        complete = self._current is None and not self._problems
        now, start = self._flight.now.time_s, self._start_s
        return Verdict(
            steps=tuple(result for step in self._steps for result in step.results),
            rules=(
                *(rule.result(complete=complete) for rule in self._rules),
                *self._default_rules(complete=complete),
            ),
            touchdowns=self._flight.touchdowns,
            lasted_s=0.0 if start is None else now - start,
            ended=self._end_reason,
            problems=tuple(self._problems),
        )

    def _default_rules(self, *, complete: bool) -> Iterator[RuleResult]:
        """Yield the results of the default rules, which apply to every scenario."""
        allowed = self._scenario.allowed
        crashes = [f"{v} crashed: {why}" for v, why in self._flight.crashes.items() if v not in allowed.crash]
        yield self._default_rule(_CRASH, crashes)
        if not allowed.stay_up:
            up = self._flight.still_up if complete else ()
            end = f"{self._end_reason} came at {self._flight.now.time_s:.2f} s"
            found = [f"{v} {self._where(v)}, {end}" for v in up]
            yield self._default_rule(_LANDED, found, reached=complete)
        accepted = self._targeted | allowed.fail
        failed = [
            f"{process}: {why} (to accept this, write `may: [fail {process}]`)"
            for process, why in self._failed_processes.items()
            if process not in accepted
        ]
        yield self._default_rule(_PROCESSES, failed, reached=self._has_outcome)

    def _default_rule(self, text: str, failures: list[str], *, reached: bool = True) -> RuleResult:
        place = Place(file=self._scenario.place.file, line=self._scenario.place.line, text=text)
        outcome: Outcome = "failed" if failures else "passed" if reached else "not reached"
        return RuleResult(place=place, outcome=outcome, failure="; ".join(failures))

    def _where(self, name: str) -> str:
        vehicle = self._flight.now.vehicles.get(name)
        if vehicle is None:
            return "was no longer observed"
        if vehicle.airborne:
            return f"was in the air in {vehicle.mode or 'an unknown mode'}, {vehicle.height_m:.2f} m above the floor"
        return "was on the floor and " + (
            "armed or not is unknown" if vehicle.armed is None else "still armed"
        )


def _waited_for(trigger: Trigger | None) -> str:
    return "its turn" if trigger is None else trigger.place.text
