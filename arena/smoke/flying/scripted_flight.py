"""Flight that a Python test controls step by step.

Actions and expectations are written as in scenario files.

    with ScriptedFlight(arena, options) as flight:
        flight.always("separation > 0.8 m")
        flight.until("uav1.airborne", 20)
        flight.do("kill program uav1")
        flight.expect("uav1.mode == LAND within 2 s")
        assert flight.vehicle("uav1").p_n[0] < 3.0

Simulation time passes only inside these calls. If an expectation or a rule fails, AssertionError is raised with the
observed values.
"""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Self, TypeVar

from arena.errors import InputError
from arena.schema import Arena
from arena.smoke.flying.fly_scenario import alone_if_px4
from arena.smoke.flying.session import LaunchOptions, Session
from arena.smoke.language.grammar import read_action, read_expectation, read_rule, read_trigger
from arena.smoke.language.model import Action, Observation, Place, VehicleState
from arena.smoke.language.names import Names, names_of
from arena.smoke.language.scenario import fence_of
from arena.smoke.language.tokens import WrongWordError
from arena.smoke.referee.conditions import holds
from arena.smoke.referee.expectation import EPSILON_S, ExpectationTracker
from arena.smoke.referee.flight_history import FlightHistory
from arena.smoke.referee.rules import RuleTracker

T = TypeVar("T")


class ScriptedFlight:
    """Context manager that starts an arena for a test and ends it. The test controls the flight with its methods.

    arena: the arena loaded from `options.arena` with its overrides.
    All methods raise InputError, with the line of the test, if a text is not valid in the scenario language.
    """

    def __init__(self, arena: Arena, options: LaunchOptions) -> None:
        # a test may kill any process, which is not known before the flight
        separate = ("sim.processes=many", *options.overrides)
        self.session = Session(replace(options, overrides=separate))
        self._alone = alone_if_px4(arena)
        self._names = names_of(arena)
        self._flight = FlightHistory(vehicles=tuple(v.name for v in arena.vehicles), fence=fence_of(arena))
        self._rules: list[RuleTracker] = []
        self._undo: list[tuple[float, Action]] = []

    def __enter__(self) -> Self:
        self._alone.__enter__()
        try:
            self.session.__enter__()
        except BaseException:
            self._alone.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.session.close()
        finally:
            self._alone.__exit__(None, None, None)
        if kind is None and (broken := self._failures()):
            raise AssertionError("\n".join(broken))

    @property
    def now(self) -> Observation:
        """The newest observation."""
        if not self._flight.now.vehicles:
            self._observe()
        return self._flight.now

    def vehicle(self, name: str) -> VehicleState:
        """Return the state of a vehicle at the newest observation."""
        return self.now.vehicles[name]

    def until(self, trigger: str, limit_s: float) -> Observation:
        """Wait until a trigger is reached, such as `uav1.airborne + 3 s` (3 s after takeoff).

        limit_s: longest wait in simulation time [s]; AssertionError is raised after it.
        """
        read = self._read(trigger, read_trigger)
        begun = self.now.time_s
        since = None if read.condition is not None else begun
        while since is None or self.now.time_s < since + read.after_s - EPSILON_S:
            if since is None and read.condition is not None and holds(read.condition, self._flight):
                since = self.now.time_s
                continue
            if self.now.time_s - begun > limit_s:
                raise AssertionError(
                    f"the trigger `{trigger}` was not reached within {limit_s:g} s of simulation time"
                )
            self._observe()
        return self.now

    def wait(self, time_s: float) -> Observation:
        """Wait for `time_s` seconds of simulation time."""
        return self.until(f"then + {time_s!r} s", time_s + 1.0)

    def do(self, action: str) -> None:
        """Carry out an action, such as `kill program uav1`. Raises RunError if that is not possible."""
        read = self._read(action, read_action)
        self._flight.now = self.now
        self._flight.action()
        self.session.observer.do(read)
        if read.for_s is not None:
            self._undo.append((self.now.time_s + read.for_s, replace(read, undo=True)))

    def expect(self, expectation: str) -> Observation:
        """Wait until an expectation such as `uav1.landed within 10 s` is fulfilled. The time limit starts now.

        Raises AssertionError if the expectation fails.
        """
        tracker = ExpectationTracker(
            expectation=self._read(expectation, read_expectation), begun_s=self.now.time_s
        )
        while tracker.open:
            try:
                self._observe()
            except AssertionError as ended:
                tracker.close(self._flight, str(ended))
            tracker.update(self._flight)
        if tracker.outcome == "failed":
            raise AssertionError(tracker.failure)
        return self.now

    def always(self, rule: str) -> None:
        """Check a rule such as `separation > 0.8 m` from now on, for every vehicle in flight.

        If the rule is violated, leaving the `with` block raises AssertionError.
        """
        self._rules.append(RuleTracker(rule=self._read(rule, read_rule)))

    def _observe(self) -> None:
        now = self.session.observer.observe()
        if now is None:
            self._flight.ended = True
            raise AssertionError(f"the arena ended: {self.session.observer.ended}")
        self._flight.update(now)
        for rule_tracker in self._rules:
            rule_tracker.update(self._flight)
        due = [action for at, action in self._undo if at <= now.time_s + EPSILON_S]
        self._undo = [(at, action) for at, action in self._undo if at > now.time_s + EPSILON_S]
        for action in due:
            self.session.observer.do(action)

    def _failures(self) -> list[str]:
        """Return one text per crash and per violated rule of the flight."""
        crashes = [f"{name} crashed: {how}" for name, how in self._flight.crashes.items()]
        return crashes + [
            result.failure
            for rule_tracker in self._rules
            if (result := rule_tracker.result(complete=True)).failure
        ]

    def _read(self, text: str, read: Callable[[str, Names, Place], T]) -> T:
        place = _caller(text)
        try:
            return read(text, self._names, place)
        except WrongWordError as error:
            raise InputError(f"{place.file}:{place.line}: {text}: {error}") from error


def _caller(text: str) -> Place:
    """Return the file and line of the test that called this module, for error messages.

    text: the trigger, action, expectation or rule that the test passed.
    """
    frames = [frame for frame in traceback.extract_stack() if frame.filename != __file__]
    return Place(file=os.path.relpath(frames[-1].filename), line=frames[-1].lineno or 0, text=text)
