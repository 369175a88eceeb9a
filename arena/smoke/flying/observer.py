"""Observation of a running arena 50 times per simulated second: ground truth, telemetry, and the logs of the run.

The observer is a client of the simulation clock. Simulation time stands still during an observation, for at most 1 s of
wall time. The observer needs only the world. If the router, the supervisor or a program does not reply, some values are
unknown.
"""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arena.clock import SimClock
from arena.errors import RunError
from arena.plan.model import Plan
from arena.smoke.flying.actions import ActionRunner
from arena.smoke.flying.observation import VehicleStates
from arena.smoke.flying.run_log import RunLog
from arena.smoke.flying.telemetry_listener import TelemetryListener
from arena.smoke.language.model import Action, Observation
from arena.supervisor import RunState
from arena.wire.truth_page import TruthReader

OBSERVATION_PERIOD_S = 0.02
"""Simulation time between two observations [s]."""
CLOCK_TIMEOUT_S, _POLL_S = 30.0, 0.25  # wall time


class Observer:
    """Observer of one run: returns observations for the referee, and carries out the actions of the scenario.

    plan: plan of the run.  state: content of the run's state.json.
    ended: why observation has ended, such as a world that stopped; "" while it goes on.
    problem: the same reason if it is a defect that no action of a scenario causes; else "".
    all_down: true if at the last observation every vehicle was on the floor and disarmed.
    """

    def __init__(self, plan: Plan, state: RunState) -> None:
        run, world = Path(state.run), slice_of(Path(state.run), "world")
        self.ended = self.problem = ""
        self.all_down = False
        self.run_log = RunLog(run, [spec.name for spec in plan.processes])
        self._supervisor = state.supervisor
        self._clock, self._truth = SimClock(world["clock"], "smoke"), TruthReader(world["truth"])
        self._vehicle_states = VehicleStates(world["vehicles"])
        self._listener = TelemetryListener(plan.vehicles)
        self._actions = ActionRunner(plan, run, Path(state.rt), self.run_log, self._listener)
        self._next = 0.0

    def observe(self) -> Observation | None:
        """Wait OBSERVATION_PERIOD_S of simulation time and return an observation, or None if the arena has ended.

        `ended` then has the reason.
        """
        if (
            self._actions.commands_running
        ):  # these commands use wall time, so keep the world from running faster
            time.sleep(OBSERVATION_PERIOD_S)
        try:
            # multiples of the period: observations of the same flight are then made at the same times
            self._next = (
                math.floor(self._clock.now() / OBSERVATION_PERIOD_S + 1e-6) + 1
            ) * OBSERVATION_PERIOD_S
            self._clock.request_wake(self._next)
            time_s = self._wait_for_time()
        except RunError as error:
            self.ended = str(error)
            return None
        if time_s is None:
            stalled = (
                f"simulation time has stood still at {self._clock.now():.2f} s for {CLOCK_TIMEOUT_S:g} s"
            )
            self.ended = self.problem = stalled
            return None
        return self._observation(time_s)

    def do(self, action: Action) -> None:
        """Carry out an action of the scenario, or undo it if `action.undo` is set. Raises RunError on failure."""
        self._actions.do(action)

    def idle(self, wall_s: float) -> None:
        """Wait at least `wall_s` [s] of wall time. Meanwhile the simulation advances by at most `wall_s` [s].

        Without this limit, a simulation at full speed would use the CPU that other processes need.
        """
        with contextlib.suppress(RunError):
            self._clock.request_wake(self._clock.now() + wall_s)
            self._clock.wait_for_wake(wall_s)
        time.sleep(wall_s)

    def close(self) -> None:
        """Disconnect from the simulation clock and from the router."""
        self._clock.close()
        self._listener.close()

    def _observation(self, time_s: float) -> Observation:
        self._listener.listen(time_s)
        events = tuple(self.run_log.read())
        supervised = self._supervisor.alive
        if not supervised:
            self.run_log.update_without_supervisor()
        states = {**self.run_log.states, "supervisor": "READY" if supervised else "EXITED"}
        vehicles = self._vehicle_states.update(
            self._truth.newest(), self._listener.telemetry, self.run_log.crashed, time_s
        )
        self.all_down = all(vehicle.down for vehicle in vehicles.values())
        wall_s = time.monotonic()
        return Observation(time_s=time_s, vehicles=vehicles, processes=states, events=events, wall_s=wall_s)

    def _wait_for_time(self) -> float | None:
        """Wait until the simulation reaches the time that `observe` has requested. Return the simulation time [s].

        Returns None if this takes more than CLOCK_TIMEOUT_S of wall time. Raises RunError if the world has ended.
        """
        deadline = time.monotonic() + CLOCK_TIMEOUT_S
        while (time_s := self._clock.wait_for_wake(_POLL_S)) is None and time.monotonic() < deadline:
            pass
        return time_s


def slice_of(run: Path, name: str) -> Mapping[str, Any]:
    """Return the configuration (slice) of the process `name` from the run folder."""
    found: dict[str, Any] = json.loads((run / "slices" / f"{name}.json").read_text())
    return found
