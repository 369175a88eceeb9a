"""A flight led line by line by a test of one's own, in the words of scenarios.

    with ScriptedFlight(arena, start) as flight:
        flight.always("separation > 0.8 m")
        flight.until("uav1.airborne", 20)
        flight.do("kill program uav1")
        flight.expect("uav1.mode == LAND within 2 s")
        assert flight.vehicle("uav1").p_n[0] < 3.0

Simulation time goes on only inside these calls. What does not come true is an AssertionError with what was seen.
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
from arena.smoke.flying.session import Session, Start
from arena.smoke.language.grammar import Names, read_deed, read_expectation, read_moment, read_rule
from arena.smoke.language.model import Deed, Now, Place, VehicleNow
from arena.smoke.language.scenario import fence_of, names_of
from arena.smoke.language.tokens import WrongWordError
from arena.smoke.referee.conditions import holds
from arena.smoke.referee.expectation import EPSILON_S, ExpectationTracker
from arena.smoke.referee.flight_history import Flight
from arena.smoke.referee.rules import Watch

T = TypeVar("T")


class ScriptedFlight:
    """arena: as loaded from start.arena with its overrides. A word that is wrong is an InputError with the line of the test."""

    def __init__(self, arena: Arena, start: Start) -> None:
        self.session = Session(start)
        self._alone = alone_if_px4(arena)
        self._names = names_of(arena)
        self._flight = Flight(vehicles=tuple(v.name for v in arena.vehicles), fence=fence_of(arena))
        self._rules: list[Watch] = []
        self._undo: list[tuple[float, Deed]] = []

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
        if kind is None and (broken := self._broken()):
            raise AssertionError("\n".join(broken))

    @property
    def now(self) -> Now:
        """The last look."""
        if not self._flight.now.vehicles:
            self._look()
        return self._flight.now

    def vehicle(self, name: str) -> VehicleNow:
        """As it was at the last look."""
        return self.now.vehicles[name]

    def until(self, moment: str, limit_s: float) -> Now:
        """Time goes on until the moment has come, `uav1.airborne + 3 s`, but not for longer than limit_s [s]."""
        read = self._read(moment, read_moment)
        begun = self.now.time_s
        since = None if read.condition is not None else begun
        while since is None or self.now.time_s < since + read.after_s - EPSILON_S:
            if since is None and read.condition is not None and holds(read.condition, self._flight):
                since = self.now.time_s
                continue
            if self.now.time_s - begun > limit_s:
                raise AssertionError(f"{moment}: not within {limit_s:g} s of simulation time")
            self._look()
        return self.now

    def wait(self, time_s: float) -> Now:
        """Time goes on for so long [s]."""
        return self.until(f"then + {time_s!r} s", time_s + 1.0)

    def do(self, deed: str) -> None:
        """Raises RunError where it cannot be done."""
        read = self._read(deed, read_deed)
        self._flight.now = self.now
        self._flight.deed()
        self.session.seat.do(read)
        if read.for_s is not None:
            self._undo.append((self.now.time_s + read.for_s, replace(read, undo=True)))

    def expect(self, expectation: str) -> Now:
        """Counted from now."""
        hope = ExpectationTracker(
            expectation=self._read(expectation, read_expectation), begun_s=self.now.time_s
        )
        while hope.state == "open":
            try:
                self._look()
            except AssertionError as ended:
                hope.cut(self._flight, str(ended))
            hope.see(self._flight)
        if hope.state == "failed":
            raise AssertionError(hope.failure)
        return self.now

    def always(self, rule: str) -> None:
        """From now on, for whoever is in flight; judged when the flight is over."""
        self._rules.append(Watch(rule=self._read(rule, read_rule)))

    def _look(self) -> None:
        now = self.session.seat.look()
        if now is None:
            self._flight.ended = True
            raise AssertionError(f"the arena ended: {self.session.seat.ended}")
        self._flight.see(now)
        for watch in self._rules:
            watch.see(self._flight)
        due = [deed for at, deed in self._undo if at <= now.time_s + EPSILON_S]
        self._undo = [(at, deed) for at, deed in self._undo if at > now.time_s + EPSILON_S]
        for deed in due:
            self.session.seat.do(deed)

    def _broken(self) -> list[str]:
        """What breaks a flight that nobody has complained of yet."""
        crashes = [f"{name} crashed: {how}" for name, how in self._flight.crashes.items()]
        return crashes + [
            result.failure for watch in self._rules if (result := watch.result(complete=True)).failure
        ]

    def _read(self, text: str, read: Callable[[str, Names, Place], T]) -> T:
        place = _caller(text)
        try:
            return read(text, self._names, place)
        except WrongWordError as error:
            raise InputError(f"{place.file}:{place.line}: {text}: {error}") from error


def _caller(text: str) -> Place:
    """The line of the test that led here."""
    frames = [frame for frame in traceback.extract_stack() if frame.filename != __file__]
    return Place(file=os.path.relpath(frames[-1].filename), line=frames[-1].lineno or 0, text=text)
