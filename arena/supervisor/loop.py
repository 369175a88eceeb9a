"""The supervisor: starts a plan, keeps it running, lands what flies, stops everything, and writes down what happened.

One thread, one selector. The phases of a run:

    RUN  --an end-->  LAND  --on the ground, disarmed-->  STOP  --nothing runs-->  REPORT  -->  OVER

RUN restarts what dies; from LAND on nothing is started any more. In LAND everything goes on running, programs too:
their setters raise when the landing takes OFFBOARD away. A second Ctrl-C kills the programs at once; what serves a
flying vehicle is never stopped before the landing has ended. `arena down --now` lands real vehicles alone: nothing is lost with
simulated ones, and all that runs is told to stop at once.
"""

from __future__ import annotations

import os
import selectors
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any, Protocol

from arena.errors import EXIT_OK
from arena.plan.model import Plan
from arena.supervisor import child_process, outcome, shutdown_policy
from arena.supervisor.control_socket import ControlServer
from arena.supervisor.event_log import Journal
from arena.supervisor.landing_task import Landing
from arena.supervisor.process_set import Fleet, Orders
from arena.supervisor.process_state import ENDED, Exit, State
from arena.supervisor.run_folder import RunFolder
from arena.supervisor.shutdown_policy import Cause, End
from arena.supervisor.side_task import Task
from arena.supervisor.signals import SignalQueue

SETTLE_S = 0.5
REPORT_TIMEOUT_S = 120.0
_QUICK_S, _CALM_S = 0.05, 0.25

_CAUSES = {signal.SIGINT: Cause.INTERRUPT, signal.SIGTERM: Cause.TERMINATED, signal.SIGHUP: Cause.HANGUP}


class Phase(StrEnum):
    RUN = "running"
    LAND = "landing"
    STOP = "stopping"
    REPORT = "reporting"
    OVER = "over"


class Show(Protocol):
    """The terminal's side. Called from the loop; none of it may raise or wait."""

    def say(self, text: str) -> None: ...

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None: ...

    def started(self, failed: list[str]) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Options:
    """until_done: end when every program has ended and every vehicle is disarmed.  time_limit_s: end after it [s].

    adopt: take in descendants that fork away, to end them with their program; for a process with no children but ours.
    """

    until_done: bool = False
    time_limit_s: float | None = None
    adopt: bool = False


class Supervisor:
    """One run of one plan. `run()` returns the exit code."""

    def __init__(self, plan: Plan, folder: RunFolder, show: Show, options: Options) -> None:
        self.plan, self.folder, self.options, self._show = plan, folder, options, show
        self.phase = Phase.RUN
        self._selector = selectors.DefaultSelector()
        self._journal = Journal(folder.path / "events.jsonl", self._say)
        self._control: ControlServer | None = None
        self._fleet = Fleet(plan, folder, self._journal, self._selector)
        self._landing = Landing(plan, folder, self._journal)
        self._orders = Orders()
        self._end: End | None = None
        self._at_once = False
        self._report: Task | None = None
        self._began, self._began_wall = time.monotonic(), datetime.now().astimezone()
        self._quiet_since: float | None = None
        self._next_turn = self._next_sample = 0.0
        self._recorded: set[int] | None = None
        self._all_started = False
        self._exit_code = EXIT_OK

    def run(self) -> int:
        """Must be called in the main thread: it takes the signals over and forks."""
        if self.options.adopt:
            child_process.adopt_orphans()
        with SignalQueue() as signals:
            self._selector.register(signals.fd, selectors.EVENT_READ, signals.drain)
            self._control = ControlServer(
                self.folder.control, self._selector, self.answer, refused=self._event
            )
            while self.phase is not Phase.OVER:
                self._turn(signals)
            self._control.close()
            self._control = None
            self._selector.close()
            self._journal.close()
            self.folder.close()
        return self._exit_code

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """One request of the control socket."""
        match request.get("do"):
            case "ps":
                return self.status()
            case "restart":
                return self._restart(str(request.get("name")))
            case "down":
                now = request.get("now") is True
                if now and not self._at_once and self._landing.task is not None:
                    self._landing.task.stop("arena down --now")  # it lands simulated vehicles too
                self._at_once |= now
                self._ask_end(Cause.DOWN, hurry=now)
                return {"ok": True}
        raise ValueError(f"unknown request {request.get('do')!r}: ps, restart, down and subscribe are known")

    def status(self) -> dict[str, Any]:
        now = time.monotonic()
        return {
            "name": self.plan.name,
            "run": str(self.folder.path),
            "phase": str(self.phase),
            "pid": os.getpid(),
            "up_s": round(now - self._began, 1),
            "vehicles": [v.name for v in self.plan.vehicles],
            "facts": dict(self._fleet.facts),
            "refused": sum(self._control.refused.values()) if self._control is not None else 0,
            "processes": self._fleet.table(now),
        }

    def _turn(self, signals: SignalQueue) -> None:
        timeout_s = 0.0 if self._fleet.changed else max(0.0, self._next_turn - time.monotonic())
        for key, _ in self._selector.select(timeout_s):
            key.data()
        now = time.monotonic()
        for number in signals.take():
            self._fleet.changed = True
            if number in _CAUSES:
                self._ask_end(_CAUSES[signal.Signals(number)], hurry=number == signal.SIGINT)
            elif number == signal.SIGTSTP:
                self._say(
                    "Ctrl-Z does not stop an arena: nobody would look after what flies. Ctrl-C lands it"
                )
        if self._fleet.changed or now >= self._next_turn:
            self._decide(now)
        if now >= self._next_sample:
            self._next_sample = now + 1.0
            self._fleet.sample(now)
        self._show.refresh(self.status, now)

    def _decide(self, now: float) -> None:
        self._fleet.reconcile(self._orders, now)
        self._fleet.cut_logs(now)
        if self.options.adopt:
            self._end_runaways(now)
        self._record()
        match self.phase:
            case Phase.RUN:
                self._running(now)
            case Phase.LAND:
                self._land(now)
            case Phase.STOP:
                self._stop(now)
            case Phase.REPORT:
                self._reporting(now)
        settled = all(life.state in ENDED | {State.READY} for life in self._fleet.lives.values())
        self._next_turn = now + (_CALM_S if settled and self.phase is Phase.RUN else _QUICK_S)

    # -- RUN

    def _running(self, now: float) -> None:
        lives, limit = self._fleet.lives, self.options.time_limit_s
        if lost := shutdown_policy.lost(self.plan, lives):
            self._begin_end(Cause.LOST, lost)
        elif limit is not None and now - self._began >= limit:
            self._begin_end(Cause.TIME_LIMIT, f"the time limit of {limit:g} s is over")
        elif self.options.until_done and self._is_quiet(now):
            self._begin_end(Cause.DONE, "every program has ended and every vehicle is disarmed")
        else:
            self._tell_started()

    def _tell_started(self) -> None:
        begun = all(life.started or life.state in ENDED for life in self._fleet.lives.values())
        waiting = any(life.state is State.STARTING for life in self._fleet.lives.values())
        if begun and not waiting and not self._all_started:
            self._all_started = True
            self._show.started(
                [f"{n}: {x.reason}" for n, x in self._fleet.lives.items() if x.state is State.FATAL]
            )

    def _is_quiet(self, now: float) -> bool:
        if not shutdown_policy.is_done(self.plan, self._fleet.lives, self._fleet.facts, self._fleet.stats):
            self._quiet_since = None
            return False
        self._quiet_since = now if self._quiet_since is None else self._quiet_since
        return now - self._quiet_since >= SETTLE_S

    def _restart(self, name: str) -> dict[str, Any]:
        if name not in self._fleet.specs:
            raise ValueError(f"no process {name!r} in this arena; there are {', '.join(self._fleet.specs)}")
        if self.phase is not Phase.RUN:
            raise ValueError(f"the arena is {self.phase}: nothing is started any more")
        self._fleet.ask_restart(name)
        self._journal.event(time.monotonic(), name, "a person asked for a restart")
        return {"ok": True}

    # -- the end

    def _ask_end(self, cause: Cause, *, hurry: bool) -> None:
        """A person wants the run to end; asked again, with `hurry`, programs are not waited for."""
        first = self.phase is Phase.RUN
        if first:
            self._begin_end(
                cause, f"{cause} --now: stopping" if self._at_once else f"{cause}: landing, then stopping"
            )
        if self.phase is Phase.REPORT and self._report is not None and hurry:
            self._report.stop()
        elif hurry and (not first or cause is Cause.DOWN) and not self._orders.kill:
            programs = {spec.name for spec in self.plan.processes if spec.kind == "program"}
            self._orders.kill, self._orders.why = programs, f"{cause}: not waited for"
            serves = "a real vehicle" if self._at_once else "a vehicle"
            self._event(f"programs are killed; whatever serves {serves} goes on until it has landed")
        elif not first:
            self._say(f"{self.phase}: waiting for {self._waited_for()}")
        self._fleet.changed = True

    def _begin_end(self, cause: Cause, why: str) -> None:
        self._end = End(cause=cause, why=why, lives=dict(self._fleet.lives))
        self._orders.starts_on, self._orders.why = False, f"the run ends: {cause}"
        self.phase = Phase.LAND
        self._fleet.changed = True
        self._event(why)

    def _land(self, now: float) -> None:
        fleet = self._fleet
        flying = shutdown_policy.may_fly(self.plan, fleet.lives, fleet.facts, fleet.told, fleet.stats)
        down = shutdown_policy.grounded(self.plan, fleet.lives, fleet.stats)
        if self._at_once:
            flying, down = self._real_alone(flying, down)
        if self._landing.step(
            flying, now, world_gone=shutdown_policy.is_world_gone(self.plan, fleet.lives), down=down
        ):
            self.phase = Phase.STOP
            fleet.changed = True

    def _real_alone(self, flying: list[str], down: dict[str, str]) -> tuple[list[str], dict[str, str]]:
        """What may fly and is waited for, and what is not, when simulated vehicles are not landed."""
        simulated = {v.name for v in self.plan.vehicles if v.simulated}
        left = simulated & set(flying)
        if left:
            self._landing.words = f"{', '.join(sorted(left))} not landed: {Cause.DOWN} --now"
        real = [name for name in flying if name not in simulated]
        return real, {**down, **dict.fromkeys(sorted(left), f"{Cause.DOWN} --now lands real vehicles alone")}

    def _stop(self, now: float) -> None:
        alive = set(self._fleet.alive)
        if alive:
            turn = alive if self._at_once else shutdown_policy.may_stop(self.plan, self._fleet.lives) & alive
            self._orders.stop |= turn or alive
            self._fleet.changed = self._fleet.changed or any(
                self._fleet.lives[name].state is not State.STOPPING for name in turn
            )
            return
        self._write_outcome(now)
        self._begin_report(now)

    def _write_outcome(self, now: float) -> None:
        assert self._end is not None
        landed, stats = self._landing.landed, self._fleet.stats
        failed = shutdown_policy.failures(
            self.plan, self._end, self._fleet.lives, stats, landed, self.options.until_done
        )
        self._exit_code = shutdown_policy.exit_code(self._end, failed, landed)
        for words in failed:
            self._event(f"failed: {words}")
        outcome.write(
            self.folder,
            name=self.plan.name,
            began=self._began_wall,
            lasted_s=now - self._began,
            end=self._end,
            exit_code=self._exit_code,
            failed=failed,
            landing=self._landing.words,
            facts=self._fleet.told,
            table=self._fleet.table(now),
        )

    def _begin_report(self, now: float) -> None:
        self.phase = Phase.OVER
        if self.plan.report is not None:
            begun = Task.start(self.plan.report, self.folder, REPORT_TIMEOUT_S, now, _unsaid)
            if isinstance(begun, Exit):
                self._event(f"no report: {begun.words}")
            else:
                self._report, self.phase = begun, Phase.REPORT

    def _reporting(self, now: float) -> None:
        exit = self._report.poll(now) if self._report is not None else Exit(code=0, words="")
        if exit is not None:
            self.phase = Phase.OVER
            if exit.code:
                self._event(
                    f"the report failed: {exit.words}; see {self.folder.log(self._report.name if self._report else '')}"
                )

    # -- what goes on in every phase

    def _waited_for(self) -> str:
        if self.phase is Phase.LAND:
            return self._landing.words
        return ", ".join(self._fleet.alive) or "the report"

    def _record(self) -> None:
        """state.json, whenever somebody came or went, so that a killed supervisor's children can be found."""
        members = self._fleet.members()
        if (pids := {m.pid for m in members.values()}) != self._recorded:
            self._recorded = pids
            try:
                self.folder.write_state(self.plan, members)
            except OSError as error:
                self._event(
                    f"state.json cannot be written ({error.strerror}): a killed supervisor's processes could not be found"
                )

    def _end_runaways(self, now: float) -> None:
        tasks = [task for task in (self._landing.task, self._report) if task is not None]
        known = {c.pid for c in self._fleet.children.values()} | {task.child.pid for task in tasks}
        alive = set(self._fleet.children) | {task.name for task in tasks}
        mark = f"{child_process.RUN}={self.folder.path}"
        for pid in child_process.reap_adopted(known, mark, alive):
            self._event(f"killed process {pid}, which had left the group of its program and outlived it")

    def _event(self, text: str) -> None:
        self._journal.event(time.monotonic(), "arena", text)

    def _say(self, text: str) -> None:
        self._show.say(text)
        if self._control is not None:
            self._control.say(text)


def _unsaid(text: str) -> None:
    """The report's own output stays in its log: who started the run prints the summary that it writes."""
