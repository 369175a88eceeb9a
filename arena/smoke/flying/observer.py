"""A referee's seat in a running arena: it sees the truth, hears the vehicles, reads what the arena writes down, and spoils.

It is a client of the simulation clock: while it looks, time stands still, for a second of wall time at most. What fails to answer
is unknown and nothing more: a router, a supervisor or a program may be dead or stopped. Only with the world all seeing ends.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arena.clock import SimClock
from arena.errors import RunError
from arena.plan.model import Plan
from arena.smoke.flying.actions import ActionRunner
from arena.smoke.flying.observation import Eyes
from arena.smoke.flying.run_log import RunLog
from arena.smoke.flying.telemetry_listener import TelemetryListener
from arena.smoke.language.model import Deed, Now
from arena.supervisor import RunState
from arena.wire.truth_page import TruthReader

LOOK_S = 0.02
"""Of simulation time, between two looks."""
_STILL_S, _PATIENCE_S = 30.0, 0.25  # wall time


class Observer:
    """plan, state: of the run, whose world serves the time. ended: why there is nothing more to see. trouble: the same, where no
    scenario may bring it about. all_down: at the last look every vehicle was on the floor and disarmed.
    """

    def __init__(self, plan: Plan, state: RunState) -> None:
        run, world = Path(state.run), slice_of(Path(state.run), "world")
        self.ended = self.trouble = ""
        self.all_down = False
        self.chronicle = RunLog(run, [spec.name for spec in plan.processes])
        self._supervisor = state.supervisor
        self._clock, self._truth = SimClock(world["clock"], "smoke"), TruthReader(world["truth"])
        self._eyes = Eyes(world["vehicles"])
        self._ears = TelemetryListener(plan.vehicles)
        self._doer = ActionRunner(plan, run, Path(state.rt), self.chronicle, self._ears)
        self._next = self._clock.now()

    def look(self) -> Now | None:
        """The next look, LOOK_S later; None when there is nothing more to see, and `ended` says why."""
        if self._doer.commanding:  # it lives on wall time, and should meet a world that keeps its pace
            time.sleep(LOOK_S)
        try:
            self._next = max(self._next, self._clock.now()) + LOOK_S
            self._clock.ask(self._next)
            time_s = self._awaited()
        except RunError as error:
            self.ended = str(error)
            return None
        if time_s is None:
            self.ended = self.trouble = (
                f"simulation time has stood still at {self._clock.now():.2f} s for {_STILL_S:g} s"
            )
            return None
        return self._now(time_s)

    def do(self, deed: Deed) -> None:
        """Carry it out, or take it back. Raises RunError where it cannot be done."""
        self._doer.do(deed)

    def linger(self, wall_s: float) -> None:
        """Let so much time pass, at the wall's pace and seen by nobody."""
        with contextlib.suppress(RunError):
            self._clock.ask(self._clock.now() + wall_s)
            self._clock.told(wall_s)
        time.sleep(wall_s)

    def leave(self) -> None:
        """Time goes on without it."""
        self._clock.close()
        self._ears.close()

    def _now(self, time_s: float) -> Now:
        self._ears.listen(time_s)
        events = tuple(self.chronicle.read())
        supervised = self._supervisor.alive
        if not supervised:
            self.chronicle.look_who_is_left()
        states = {**self.chronicle.states, "supervisor": "READY" if supervised else "EXITED"}
        seen = self._eyes.see(self._truth.newest(), self._ears.told, self.chronicle.crashed, time_s)
        self.all_down = all(vehicle.down for vehicle in seen.values())
        return Now(time_s=time_s, vehicles=seen, processes=states, events=events)

    def _awaited(self) -> float | None:
        """The time when it has come; None when the world stands still. Raises RunError when it has ended."""
        deadline = time.monotonic() + _STILL_S
        while (time_s := self._clock.told(_PATIENCE_S)) is None and time.monotonic() < deadline:
            pass
        return time_s


def slice_of(run: Path, name: str) -> Mapping[str, Any]:
    """As the supervisor has filled it in."""
    found: dict[str, Any] = json.loads((run / "slices" / f"{name}.json").read_text())
    return found
