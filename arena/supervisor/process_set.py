"""All processes of one plan: starts and stops them as `process_state.step` decides, and collects the data that they send.

This module does not decide when a run ends. Only the main loop (`loop.py`) calls it.
"""

from __future__ import annotations

import selectors
import signal
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from arena.plan.model import Plan, ProcessSpec
from arena.supervisor import child_process, messages, run_end
from arena.supervisor.armed_reports import ArmedReports
from arena.supervisor.child_process import Child
from arena.supervisor.event_log import EventLog
from arena.supervisor.fork_client import ForkClient
from arena.supervisor.messages import VehicleChanges
from arena.supervisor.meters import Meter
from arena.supervisor.missed_landings import MissedLandings
from arena.supervisor.packets import program_ended, reporter, within_limit
from arena.supervisor.process_rows import member_rows, process_row
from arena.supervisor.process_state import ALIVE, ENDED, Action, Exit, Observation, ProcessStatus, State, step
from arena.supervisor.readiness import proof_of
from arena.supervisor.release import restore_requests
from arena.supervisor.run_folder import Member, RunFolder
from arena.supervisor.start_limit import StartLimit

VEHICLE_FACTS = (
    *(".armed", ".landed", ".connected", ".mode", ".airborne_s"),
    *(".control", ".blocked", ".blocked_at_link", ".standing", ".standing_at_link"),
)
"""Ends of the names of facts about a vehicle. User programs and tools may not send these facts."""

_LONGEST_ROUND_S = 0.5


@dataclass(kw_only=True)
class Orders:
    """Requests of the main loop to the `ProcessSet`: whether to start processes, which processes to stop or kill, and why.

    starts_on: processes may be started.
    keep: names of the processes that are restarted even if `starts_on` is false, because vehicles are landing.
    hold: names of the processes that are not killed after their stop signal, because they serve an armed real vehicle.
    armed: names of the user programs' processes that have an armed real vehicle.
    stop: names of the processes to terminate.
    kill: names of the processes to kill at once.
    why: the reason, as text for the log.
    """

    starts_on: bool = True
    keep: frozenset[str] = frozenset()
    hold: frozenset[str] = frozenset()
    armed: frozenset[str] = frozenset()
    stop: set[str] = field(default_factory=set)
    kill: set[str] = field(default_factory=set)
    why: str = ""


class ProcessSet:
    """The processes of a plan, their status and the values that they send.

    facts: values such as `uav1.armed: true`, from processes that still run.
    last_facts: the last value of every fact, also from processes that have ended.
    stats: process -> its measurements.
    confirmed: process -> `id` of the last request that it has carried out.
    missed: landings that a process gets at its start, because it was not ready when `land-all` commanded them.
    armed_reports: vehicles that were reported as armed, also while the supervisor was paused.
    changed: true if something happened that the loop must handle without waiting for the next period.
    forks: client of the fork server; None without a fork server.
    """

    def __init__(
        self,
        plan: Plan,
        folder: RunFolder,
        log: EventLog,
        selector: selectors.BaseSelector,
        forks: ForkClient | None = None,
    ) -> None:
        self.plan, self.folder, self.log = plan, folder, log
        self.specs = {spec.name: spec for spec in plan.processes}
        self.statuses = {name: ProcessStatus(since=time.monotonic()) for name in self.specs}
        self.children: dict[str, Child] = {}
        self.meters = {name: Meter() for name in self.specs}
        self.facts: dict[str, Any] = {}
        self.last_facts: dict[str, Any] = {}
        self.stats: dict[str, dict[str, Any]] = {name: {} for name in self.specs}
        self.confirmed: dict[str, int] = {}
        self.stats |= {member.name: {} for spec in self.specs.values() for member in spec.members}
        self.changed, self.missed = True, MissedLandings()
        self._selector, self.forks, self._vehicle_changes = selector, forks, VehicleChanges()
        self._fact_source: dict[str, str] = {}
        self._names: dict[str, set[str]] = {}  # process -> names of its facts
        self._ready: set[str] = set()
        self._members = {m.name for s in self.specs.values() if not s.is_program for m in s.members}
        self._silent_s: dict[str, float] = {}
        self._reconciled_at: float | None = None
        self._start_limit = StartLimit(forks)
        self._exits: dict[str, Exit] = {}
        self._restarts: set[str] = set()
        self._ending = False
        self.armed_reports = ArmedReports()
        self._standing: list[tuple[frozenset[str], dict[str, Any]]] = []
        if forks is not None:
            forks.watch(selector, partial(setattr, self, "changed", True))

    def end_fork_server(self, *, unless_copy: bool = False) -> None:
        """End the fork server.

        unless_copy: do not end a fork server that was forked from this process. The report task uses it later.
        """
        if self.forks is not None and not (unless_copy and self.forks.is_copy):
            self.forks.close()

    @property
    def alive(self) -> list[str]:
        """Names of the processes that are running."""
        return [name for name, status in self.statuses.items() if status.state in ALIVE]

    def request_restart(self, name: str) -> None:
        """Restart a process in the next cycle of the loop. Raises KeyError when the plan has no such process."""
        self._restarts.add(self.specs[name].name)
        self.changed = True

    def request(self, packet: dict[str, Any], *, to: Collection[str], standing: bool = False) -> list[str]:
        """Send a request to the processes named in `to`. Return the names of the processes that could not receive the request.

        standing: send it also to each of these processes that starts later.
        """
        if standing:
            self._standing.append((frozenset(to), packet))
        return [name for name in to if name not in self.children or not self.children[name].send(packet)]

    def reconcile(self, orders: Orders, now: float) -> None:
        """Update the state of every process, and start, stop or kill processes as this state requires. Ended processes are collected first.

        Repeats while something changes: a process that becomes ready allows others to start. now: monotonic [s].
        """
        self._ending = not orders.starts_on
        self._start_limit.update(now)
        self._count_silence(now)
        for child in self.children.values():
            child.send_kept()
        for _ in range(2 + len(self.specs)):
            self.changed = False
            self._start_limit.drop_loaded(self.children, now)
            self._reap(now)
            for name, spec in self.specs.items():
                self._step(spec, self._observe(name, spec, orders, now), now)
            if not self.changed:
                return

    def _count_silence(self, now: float) -> None:
        """Add the time since the previous call to the silence of each process, the time since its last packet.

        At most _LONGEST_ROUND_S is added. A supervisor that was itself paused, or a machine that stood still, thus does not
        make every process look silent.
        """
        before, self._reconciled_at = self._reconciled_at, now
        passed_s = min(now - before, _LONGEST_ROUND_S) if before is not None else 0.0
        for name in self.children:
            self._silent_s[name] = self._silent_s.get(name, 0.0) + passed_s

    def sample(self, now: float) -> None:
        """Measure CPU and memory of every process. Called about once a second. now: monotonic [s]."""
        for name, child in self.children.items():
            self.meters[name].sample(child.pid, now)

    def loads(self) -> dict[str, tuple[float, float]]:
        """Return process -> (CPU use as a fraction of one core [-], resident memory [MB]) at the last sample."""
        return {name: (self.meters[name].now_cpu, self.meters[name].now_mb) for name in self.children}

    def cut_logs(self, now: float) -> None:
        """Cut every log file that is longer than the limit (see `Child.cut_log`). now: monotonic [s]."""
        for name, child in self.children.items():
            if child.cut_log() and child.cut == 1:
                limit = child_process.LOG_LIMIT_BYTES >> 20
                text = f"log file longer than {limit} MiB: cut; the first MiB and the newest lines are kept"
                self.log.event(now, name, text)

    def members(self) -> dict[str, Member]:
        """Return process name -> its entry in state.json (pid, process group, start time), for running processes."""
        return {n: Member(pid=c.pid, pgid=c.pid, start_s=c.start_s) for n, c in self.children.items()}

    def _observe(self, name: str, spec: ProcessSpec, orders: Orders, now: float) -> Observation:
        status = self.statuses[name]
        exit = self._exits.pop(name, None)
        stopped = name in self.children and self.children[name].stopped != ""
        if (
            status.state is State.READY
            and exit is None
            and not (stopped or orders.stop or orders.kill or self._restarts)
        ):
            if spec.silent_for_s is None and name not in orders.armed:
                return _NOTHING
            return Observation(silent_s=self._silent_s.get(name, 0.0), armed=name in orders.armed)
        names = run_end.needs_of(spec, self.specs, restart=status.started > 0)
        needs = [(self.specs[name], self.statuses[name]) for name in names]
        restart = name in self._restarts
        self._restarts.discard(name)
        return Observation(
            needs_ready=(status.started > 0 or self._start_limit.allows_start)
            and all(run_end.is_usable(*need) for need in needs)
            and all(n in self._ready for n in spec.needs if n in self._members),
            needs_dead=next((need.name for need, its in needs if run_end.is_dead(need, its)), ""),
            proof=proof_of(self.children.get(name), status, now, reported=name in self._ready),
            exit=exit,
            stopped=stopped,
            starts_on=orders.starts_on or name in orders.keep,
            hold=name in orders.hold,
            armed=name in orders.armed,
            stop=name in orders.stop,
            kill=name in orders.kill,
            restart=restart,
            why="restart requested" if restart and orders.starts_on else orders.why,
        )

    def _step(self, spec: ProcessSpec, observation: Observation, now: float) -> None:
        before = self.statuses[spec.name]
        status, action = step(spec, before, observation, now)
        self.statuses[spec.name] = status
        if (status.stopped_at is None) is not (before.stopped_at is None):
            self._log_stopped(spec, before, status, now)
        if status.state is not before.state:
            level = messages.transition_level(
                status.state, kind=spec.kind, starts=status.started, ending=self._ending
            )
            self.log.transition(now, spec.name, before.state, status.state, status.reason, level=level)
            self.changed = True
            if spec.is_program and status.state in ENDED:
                worlds = [name for name, other in self.specs.items() if other.kind == "world"]
                self.request(program_ended(spec.name), to=worlds)
            was_running = before.state in (State.STARTING, State.READY)
            if was_running and status.exit is not None and status.exit.last_line:
                self.log.event(now, spec.name, f"last line of its log: {status.exit.last_line}")
        match action:
            case Action.START:
                self._start(spec, now)
            case Action.TERMINATE:
                self._signal(spec.name, signal.Signals[spec.stop_signal])
                self._signal(spec.name, signal.SIGCONT)  # a paused process does not receive the signal
            case Action.KILL:
                self._signal(spec.name, signal.SIGKILL)
                if status.state is before.state:
                    self.log.event(
                        now, spec.name, f"did not end within {spec.stop_timeout_s:g} s: killed with SIGKILL"
                    )

    def _log_stopped(
        self, spec: ProcessSpec, before: ProcessStatus, status: ProcessStatus, now: float
    ) -> None:
        child = self.children.get(spec.name)
        if child is not None and status.stopped_at is not None:
            limit = spec.stopped_for_s
            what = "the arena does not kill it" if limit is None else f"killed after {limit:g} s"
            text = f"paused by {child.stopped}; {what}; `kill -CONT {child.pid}` continues it"
            self.log.event(now, spec.name, text)
        elif child is not None and before.stopped_at is not None:
            self.log.event(
                now, spec.name, f"runs again after it was paused for {now - before.stopped_at:.1f} s"
            )

    def _signal(self, name: str, number: int) -> None:
        if name in self.children:
            self.children[name].signal(number)

    def _start(self, spec: ProcessSpec, now: float) -> None:
        self.changed = True
        self._ready -= {spec.name, *(member.name for member in spec.members)}
        self._silent_s[spec.name] = 0.0
        if self.statuses[spec.name].restarts:
            self.folder.restore(self.plan)
        forks = None if self.statuses[spec.name].restarts else self.forks
        log, path = self.folder.log(spec.name), str(self.folder.path)
        try:
            child = child_process.start(self.folder.spec(spec), log, path, forks)
        except (OSError, ValueError) as error:
            what = getattr(error, "strerror", None) or str(error)
            where = getattr(error, "filename", None) or spec.argv[0]
            self._exits[spec.name] = Exit(code=127, text=f"could not start: {where}: {what}", ran=False)
            return
        self.children[spec.name] = child
        kept = [packet for names, packet in self._standing if spec.name in names]
        restored = restore_requests(self.plan, spec, self.last_facts)
        for packet in [*kept, *restored, *self.missed.requests(spec.name)]:
            child.send(packet, keep=True)
        self._start_limit.add(spec, now, forked=child.forked)
        self.meters[spec.name].started(now)
        if child.channel is not None:
            self._selector.register(child.channel, selectors.EVENT_READ, lambda: self._receive(child))

    def _receive(self, child: Child) -> None:
        channel, garbage, name = child.channel, child.garbage, child.spec.name
        if channel is None:
            return
        fd = channel.fileno()
        for packet in child.receive():
            self._take(name, packet)
        if child.channel is None:
            self._selector.unregister(fd)
        if child.garbage and not garbage:
            text = "sent a packet that is not a JSON object; such packets are ignored"
            self.log.event(time.monotonic(), name, text)

    def _take(self, name: str, packet: Mapping[str, Any]) -> None:
        self._silent_s[name] = 0.0
        if packet.get("entered") is True or packet.get("ready") is True:
            self.changed = self._start_limit.on_loaded(name) or self.changed
        part, kind = reporter(self.specs[name], packet)
        if packet.get("ready") is True and part not in self._ready:
            self._ready.add(part)
            self.changed = True
        if isinstance(facts := packet.get("facts"), dict):
            self._take_facts(name, facts)
        if isinstance(stats := packet.get("stats"), dict):
            own = self.stats[part]
            own.update({key: stats[key] for key in within_limit(stats, own)})
            self.armed_reports.on_stats(self.specs[name], own)
        for entry in audit if isinstance(audit := packet.get("audit"), list) else ():
            if isinstance(entry, dict) and kind in ("router", "link"):
                self.log.audit(time.monotonic(), part, entry)
        if isinstance(event := packet.get("event"), str):
            self.log.event(time.monotonic(), part, event)
        if isinstance(confirmed := packet.get("confirmed"), int):
            self.confirmed[name] = confirmed
            self.changed = True

    def _take_facts(self, name: str, facts: dict[str, Any]) -> None:
        """Store the facts, such as `uav1.armed`, that process `name` has sent.

        Facts about a vehicle (VEHICLE_FACTS) from user programs and tools are ignored, because the landing relies on them. The
        number of facts is limited per process, so that no process can crowd out the facts of another.
        """
        user = self.specs[name].is_program or self.specs[name].kind == "tool"
        taken: dict[str, Any] = {}
        for key in within_limit(facts, self._names.setdefault(name, set())):
            if user and key.endswith(VEHICLE_FACTS):
                continue
            value = facts[key]
            self._names[name].add(key)
            self.changed = self.changed or self.facts.get(key) != value
            self.facts[key] = self.last_facts[key] = taken[key] = value
            self._fact_source[key] = name
        self.armed_reports.on_facts(taken)
        for message in self._vehicle_changes.on_facts(taken):
            self.log.show(message)

    def _reap(self, now: float) -> None:
        for name, child in list(self.children.items()):
            if (exit := child.reap()) is not None:
                self._remove(name, child, exit, now)

    def _remove(self, name: str, child: Child, exit: Exit, now: float) -> None:
        """Remove an ended process. Handle the packets that it still sent, keep its CPU time, and delete its facts."""
        self._receive(child)
        if child.channel is not None:
            self._selector.unregister(child.channel)
            child.close()
        del self.children[name]
        self.meters[name].ended(child.cpu_s, now)
        for key in [key for key, source in self._fact_source.items() if source == name]:
            del self._fact_source[key]
            self.facts.pop(key, None)
        self._exits[name] = exit
        self.changed = True

    def table(self, now: float) -> dict[str, dict[str, Any]]:
        """Return process name -> status values, for `arena ps --json`, the live table and outcome.json. now: monotonic [s]."""
        table = {}
        for name, spec in self.specs.items():
            child = self.children.get(name)
            table[name] = process_row(
                spec,
                self.statuses[name],
                self.meters[name],
                child.pid if child else None,
                self.stats[name],
                now,
            )
            table |= member_rows(spec, table[name], self.stats)
        return table


_NOTHING = Observation()
