"""Main loop of the supervisor: starts a plan, monitors its processes, lands the vehicles, stops all.

The loop uses one thread and one selector. Threads of their own write the terminal and the files (`background_writer.py`), so
that a frozen terminal or a full disk does not stop the loop. The phases of a run:

    RUN  --the end is decided-->  LAND  --all on the ground, disarmed-->  STOP  --no process runs-->  REPORT  -->  OVER
                                  LAND  <--a vehicle becomes armed------  STOP

In RUN, processes that end unexpectedly are restarted. In LAND only processes that vehicles need for the landing are
restarted. All processes continue, user programs too. Their setpoint calls raise an error when the landing takes the vehicle
out of OFFBOARD. If a vehicle becomes armed in STOP, the run returns to LAND (`shutdown.py`).
A second Ctrl-C kills the user programs at once. A process that serves a flying vehicle is never stopped before the
landing has ended. `arena down --now` lands real vehicles only, and stops all other processes at once.
"""

from __future__ import annotations

import os
import selectors
import signal
import time
from enum import StrEnum
from functools import partial
from typing import Any

from arena.background_writer import BackgroundWriter
from arena.plan.model import Plan
from arena.process_ties import adopt_orphans
from arena.supervisor import child_process, run_end
from arena.supervisor.arm_permit import Confirmation
from arena.supervisor.axes_check import body_requests
from arena.supervisor.control_socket import ControlServer
from arena.supervisor.event_log import EventLog
from arena.supervisor.fork_client import ForkClient
from arena.supervisor.landing_record import LandingRecord
from arena.supervisor.load_log import FILE_NAME as LOADS_FILE
from arena.supervisor.load_log import LoadLog
from arena.supervisor.messages import Level, Message, no_such_process
from arena.supervisor.meters import RealTimeMeter
from arena.supervisor.operator_presence import OperatorPresence, at_terminal
from arena.supervisor.permits import Permits
from arena.supervisor.process_set import Orders, ProcessSet
from arena.supervisor.process_state import ENDED, State
from arena.supervisor.release_task import ReleaseTask
from arena.supervisor.replay_request import replay_packet
from arena.supervisor.restart_rules import restart_refusal
from arena.supervisor.run_end import Cause, End
from arena.supervisor.run_folder import Member, RunFolder
from arena.supervisor.run_options import Options, Show
from arena.supervisor.run_result import RunResult
from arena.supervisor.shutdown import Shutdown
from arena.supervisor.signals import SignalQueue

_BUSY_ROUND_S, _CALM_ROUND_S = 0.05, 0.25
_MAX_WRITES, _FLUSH_S = 20000, 5.0

_CAUSES = {signal.SIGINT: Cause.INTERRUPT, signal.SIGTERM: Cause.TERMINATED, signal.SIGHUP: Cause.HANGUP}


class Phase(StrEnum):
    """Phase of a run, such as running, landing or stopping."""

    RUN = "running"
    LAND = "landing"
    STOP = "stopping"
    REPORT = "making the report"
    OVER = "over"


class Supervisor:
    """Main loop of a run, which supervises all processes of one plan. `run()` returns the exit code."""

    def __init__(
        self, plan: Plan, folder: RunFolder, show: Show, options: Options, forks: ForkClient | None = None
    ) -> None:
        self.plan, self.folder, self.options, self._show = plan, folder, options, show
        self.phase = Phase.RUN
        self._selector = selectors.DefaultSelector()
        self._real_time = RealTimeMeter(plan, folder)
        self._files = BackgroundWriter("files", _MAX_WRITES)
        self._log = EventLog(
            folder.path / "events.jsonl",
            self._say,
            self._files,
            vehicles=[v.name for v in plan.vehicles],
            time_s=self._real_time.time_s,
        )
        self._loads = LoadLog(folder.path / LOADS_FILE, self._files, self._real_time.time_s)
        self._control: ControlServer | None = None
        self._processes = ProcessSet(plan, folder, self._log, self._selector, forks)
        self._orders = Orders()
        self._shutdown = Shutdown(plan, folder, self._processes, self._orders, self._log)
        self._release = ReleaseTask(plan, self._processes)
        self._landings = LandingRecord(folder.path, self._processes, self._release, self._files)
        self._result = RunResult(plan, folder, self._processes, self._log, self._real_time, self._files)
        self._operator = OperatorPresence()
        self._end: End | None = None
        self._began = time.monotonic()
        confirmation = Confirmation(options.permit_by, self._began)
        self._permits = Permits(plan, self._processes, confirmation, self._show_line)
        self._quiet_since: float | None = None
        self._has_reported_idle = self._all_started = False
        self._next_round = self._next_sample = 0.0
        self._recorded: set[int] | None = None
        self._state_error, self._state_error_reported = "", False

    def run(self) -> int:
        """Run the plan to its end and return the exit code. Call it in the main thread, because it handles signals and forks."""
        if self.options.adopt:
            adopt_orphans()
        with SignalQueue() as signals:
            self._selector.register(signals.fd, selectors.EVENT_READ, signals.drain)
            self._control = ControlServer(
                self.folder.control, self._selector, self.answer, refused=self._event
            )
            if self.options.until_done:
                worlds = [spec.name for spec in self.plan.processes if spec.kind == "world"]
                self._processes.request({"do": "until_done"}, to=worlds, standing=True)
            while self.phase is not Phase.OVER:
                self._round(signals)
            self._control.close()
            self._control = None
            self._processes.end_fork_server()
            self._selector.close()
            self._log.close()
            self._loads.close()
            self._files.submit(self.folder.close)
            self._files.flush(_FLUSH_S)
        return self._result.exit_code

    def _require_run(self, refusal: str) -> None:
        """Refuse a request with ValueError (text: `refusal`) if the run is already ending."""
        if self.phase is not Phase.RUN:
            raise ValueError(refusal)

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the reply to a request of the control socket. Raises ValueError for a refused request."""
        now = time.monotonic()
        if request.get("do") == "view":  # a viewer asks by itself, so this is no sign of an operator
            return self.status()
        self._operator.on_command(now)
        match request.get("do"):
            case "ps":
                return self.status()
            case "restart":
                return self._restart(str(request.get("name")), in_flight=request.get("yes") is True)
            case "release":
                self._require_run(f"nothing is released: the arena is {self.phase}, so no vehicle may arm")
                self._release.begin(
                    [str(v) for v in request.get("vehicles") or ()], str(request.get("by")), now
                )
            case "arm_permit":
                self._require_run(f"no arm permit: the arena is {self.phase}, so no vehicle may arm")
                self._permits.grant([str(v) for v in request.get("vehicles") or ()], str(request.get("by")))
            case "preflight":
                vehicle, stop = str(request.get("vehicle")), request.get("stop") is True
                self._permits.check_axes(vehicle, str(request.get("by")), stop=stop)
            case "forget":
                self._shutdown.forget(str(request.get("vehicle")), str(request.get("by")), now)
            case "replay":
                names, packet = replay_packet(self.plan, request)
                self._processes.request(packet, to=names)
            case "down":
                self._down(at_once=request.get("now") is True)
            case other:
                raise ValueError(
                    f"got request {other!r}, expected ps, view, restart, release, arm_permit, preflight, forget, "
                    "replay, down or subscribe"
                )
        return {"ok": True}

    def _down(self, *, at_once: bool) -> None:
        """Process `arena down`: end the run.

        at_once: land real vehicles only.
        """
        if at_once and not self._shutdown.at_once and self._shutdown.landing.task is not None:
            self._shutdown.landing.task.stop("arena down --now")  # it lands simulated vehicles too
        self._shutdown.at_once |= at_once
        self._request_end(Cause.DOWN, hurry=at_once)

    def status(self) -> dict[str, Any]:
        """Return the status of the run, as `arena ps --json` prints it."""
        now = time.monotonic()
        return {
            "name": self.plan.name,
            "run": str(self.folder.path),
            "phase": str(self.phase) if self._all_started or self.phase is not Phase.RUN else "starting",
            "replay": self.plan.replay,
            "pid": os.getpid(),
            "up_s": round(now - self._began, 1),
            "time_s": self._real_time.time_s(),
            "vehicles": [v.name for v in self.plan.vehicles],
            "facts": dict(self._processes.facts),
            "releases": self._release.results,
            "refused": sum(self._control.refused.values()) if self._control is not None else 0,
            "processes": self._processes.table(now),
        }

    def _round(self, signals: SignalQueue) -> None:
        timeout_s = 0.0 if self._processes.changed else max(0.0, self._next_round - time.monotonic())
        for key, _ in self._selector.select(timeout_s):
            key.data()
        now = time.monotonic()
        for number in signals.take():
            self._processes.changed = True
            if number in _CAUSES:
                self._request_end(_CAUSES[signal.Signals(number)], hurry=number == signal.SIGINT)
            elif number == signal.SIGTSTP:
                self._show_line(
                    "Ctrl-Z is ignored, because a stopped arena cannot watch its vehicles. Use Ctrl-C to land them and stop"
                )
        if self._processes.changed or now >= self._next_round:
            self._decide(now)
        if now >= self._next_sample:
            self._next_sample = now + 1.0
            self._processes.sample(now)
            self._loads.add(self._processes.loads())
            self._report_operator(now)
            for link, packet in body_requests(self.plan, self._processes.stats):
                self._processes.request(packet, to=[link])
            if self.phase in (Phase.RUN, Phase.LAND):
                self._real_time.sample(now)
        self._show.refresh(self.status, now)

    def _decide(self, now: float) -> None:
        self._shutdown.update_armed(now)
        self._processes.reconcile(self._orders, now)
        self._release.step(now)
        self._landings.step(now)
        self._processes.cut_logs(now)
        if self.options.adopt:
            self._end_runaways(now)
        self._record()
        self._shutdown.recall_forgotten(now)
        match self.phase:
            case Phase.RUN:
                self._running(now)
            case Phase.LAND:
                if self._shutdown.land(now):
                    self.phase = Phase.STOP
            case Phase.STOP:
                self._stop(now)
            case Phase.REPORT:
                if self._result.step(now):
                    self.phase = Phase.OVER
        settled = all(s.state in ENDED | {State.READY} for s in self._processes.statuses.values())
        self._next_round = now + (_CALM_ROUND_S if settled and self.phase is Phase.RUN else _BUSY_ROUND_S)

    def _report_operator(self, now: float) -> None:
        """Report to the router once a second that an operator is present.

        Without this report, and without a ground station, the router sends no GCS heartbeat to real vehicles with a data-link
        failsafe, so that this failsafe can react. Nothing is reported while no operator is present.
        """
        if all(v.simulated for v in self.plan.vehicles):
            return
        blocked_s = self._show.blocked_s(now)
        if self._operator.present(now, terminal=at_terminal(), blocked_s=blocked_s):
            routers = [spec.name for spec in self.plan.processes if spec.kind == "router"]
            self._processes.request({"do": "operator"}, to=routers)

    # -- RUN

    def _running(self, now: float) -> None:
        statuses, limit = self._processes.statuses, self.options.time_limit_s
        if lost := run_end.lost(self.plan, statuses):
            self._begin_end(Cause.LOST, lost)
        elif limit is not None and now - self._began >= limit:
            self._begin_end(Cause.TIME_LIMIT, f"the time limit of {limit:g} s has passed")
        elif (quiet := self._is_quiet(now)) and self.options.until_done:
            self._begin_end(Cause.DONE, run_end.done_words(self.plan))
        else:
            self._report_started(now)
            self._permits.use_confirmation(now, self._all_started)
            if quiet and not self._has_reported_idle and any(s.is_program for s in self.plan.processes):
                self._has_reported_idle = True
                self._show_line(f"{run_end.done_words(self.plan)}. The arena continues: Ctrl-C ends it")

    def _report_started(self, now: float) -> None:
        statuses = self._processes.statuses
        begun = all(s.started or s.state in ENDED for s in statuses.values())
        waiting = any(s.state is State.STARTING for s in statuses.values())
        if not begun or waiting or self._all_started:
            return
        self._all_started = True
        self._processes.end_fork_server(unless_copy=True)
        failed = [f"{name}: {s.reason}" for name, s in statuses.items() if s.state is State.FATAL]
        ready = f"{len(statuses) - len(failed)} of {len(statuses)}" if failed else str(len(statuses))
        noun = "process" if ready == "1" else "processes"
        self._show_line(f"{ready} {noun} ready in {now - self._began:.1f} s")
        self._show.started(failed)

    def _is_quiet(self, now: float) -> bool:
        p, forgotten = self._processes, self._shutdown.forgotten
        done = run_end.is_done(self.plan, p.statuses, p.facts, p.stats, forgotten)
        if not done:
            self._quiet_since = None
            return False
        self._quiet_since = now if self._quiet_since is None else self._quiet_since
        return now - self._quiet_since >= run_end.settle_s(self.plan, self._processes.stats)

    def _restart(self, name: str, *, in_flight: bool) -> dict[str, Any]:
        specs = self._processes.specs
        if name not in specs:
            raise ValueError(no_such_process(name, self.plan))
        self._require_run(f"{name} is not restarted: the arena is {self.phase}, so it starts no processes")
        runs, flies_real = name in self._processes.children, name in self._orders.armed
        refusal = restart_refusal(specs[name], self._shutdown.flying(), runs=runs, flies_real=flies_real)
        if refusal and not in_flight:
            raise ValueError(refusal)
        self._processes.request_restart(name)
        self._log.event(time.monotonic(), name, "restart requested by `arena restart`")
        return {"ok": True}

    # -- the end

    def _request_end(self, cause: Cause, *, hurry: bool) -> None:
        """End the run on request of the user. A repeated request makes it end faster.

        hurry: kill the user programs without waiting, as `arena down` and a second Ctrl-C do.
        """
        first = self.phase is Phase.RUN
        if first:
            self._begin_end(cause, run_end.end_words(self.plan, cause, at_once=self._shutdown.at_once))
        if self.phase is Phase.REPORT and self._result.task is not None and hurry:
            self._result.task.stop(f"ended by {cause}")
        elif hurry and (not first or cause is Cause.DOWN) and not self._orders.kill:
            programs = {spec.name for spec in self.plan.processes if spec.is_program}
            self._orders.kill, self._orders.why = programs, f"{cause}: killed without waiting"
            serves = "a real vehicle" if self._shutdown.at_once else "a vehicle"
            self._event(f"programs are killed; processes that serve {serves} continue until it has landed")
        elif not first:
            self._show_line(f"{self.phase}: waiting for {self._waited_for()}")
        self._processes.changed = True

    def _begin_end(self, cause: Cause, why: str) -> None:
        self._end = End(cause=cause, why=why, statuses=dict(self._processes.statuses))
        self.phase = Phase.LAND
        self._processes.changed = True
        self._shutdown.begin(cause)
        self._event(why)

    def _stop(self, now: float) -> None:
        assert self._end is not None
        if self._shutdown.armed_again(now):
            self.phase = Phase.LAND
        elif self._shutdown.stop(now):
            self._result.write(self._end, self._shutdown.landing, self.options.until_done, now)
            self.phase = Phase.REPORT

    # -- in every phase

    def _waited_for(self) -> str:
        if self.phase is Phase.LAND:
            return self._shutdown.landing.summary
        return ", ".join(self._processes.alive) or "the report"

    def _record(self) -> None:
        """Write state.json if a process has started or ended. `arena down` reads state.json if this supervisor dies."""
        members = self._processes.members()
        if (pids := {m.pid for m in members.values()}) != self._recorded:
            self._recorded = pids
            self._files.submit(partial(self._write_state, members), replaces="state.json")
        if self._state_error and not self._state_error_reported:
            self._state_error_reported = True
            self._event(
                f"state.json cannot be written ({self._state_error}). If the supervisor dies, "
                f"`arena down` cannot find the processes of this run"
            )
        if error := self._log.error():
            self._show_line(
                f"events.jsonl cannot be written ({error}): the events of this run are incomplete"
            )

    def _write_state(self, members: dict[str, Member]) -> None:
        """Write state.json, or store the error if this fails. Runs in the background thread `files`."""
        try:
            self.folder.write_state(self.plan, members)
        except OSError as error:
            self._state_error = str(error.strerror)

    def _end_runaways(self, now: float) -> None:
        tasks = [task for task in (self._shutdown.landing.task, self._result.task) if task is not None]
        known = {c.pid for c in self._processes.children.values()} | {task.child.pid for task in tasks}
        alive = set(self._processes.children) | {task.name for task in tasks}
        mark = f"{child_process.RUN}={self.folder.path}"
        for pid in child_process.reap_adopted(known, mark, alive):
            self._event(f"killed process {pid}: a program or tool started it, and has ended")

    def _event(self, text: str) -> None:
        self._log.event(time.monotonic(), "arena", text)

    def _show_line(self, text: str, level: Level = Level.CHANGE) -> None:
        self._log.show(Message(text=text, level=level))

    def _say(self, message: Message) -> None:
        self._show.say(message)
        if self._control is not None and message.level >= Level.CHANGE:
            self._control.say(str(message))
