"""All processes of one plan: carries out what `life.step` decides, and gathers what the children tell.

Knows processes and facts, not why a run ends. Called by the loop only.
"""

from __future__ import annotations

import os
import selectors
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from arena.plan.model import Plan, ProcessSpec
from arena.supervisor import child_process, proc_fs, shutdown_policy
from arena.supervisor.child_process import Child, last_line
from arena.supervisor.event_log import Journal
from arena.supervisor.process_state import ALIVE, Action, Exit, Life, Seen, State, step
from arena.supervisor.resource_meter import Meter
from arena.supervisor.run_folder import Member, RunFolder

_MOST_NAMES = 2000

# Loading Python and its packages keeps a core busy for some 0.2 s. Thirty processes that do it at once would starve the world
# they are started for, so as many as there are cores do; one that tells nothing counts for a moment.
AT_ONCE = max(2, os.cpu_count() or 2)
_LOADING_S, _SILENT_LOADING_S = 1.0, 0.3


@dataclass(kw_only=True)
class Orders:
    """What is wanted now. starts_on: processes may start.  stop, kill: names; why: the reason given."""

    starts_on: bool = True
    stop: set[str] = field(default_factory=set)
    kill: set[str] = field(default_factory=set)
    why: str = ""


class Fleet:
    """facts: told by processes that still run.  told: the last of every fact ever.  stats: per process, key by key.

    changed: something happened that the next round of decisions should see at once.
    """

    def __init__(
        self, plan: Plan, folder: RunFolder, journal: Journal, selector: selectors.BaseSelector
    ) -> None:
        self.plan, self.folder, self.journal = plan, folder, journal
        self.specs = {spec.name: spec for spec in plan.processes}
        self.lives: dict[str, Life] = {name: Life(since=time.monotonic()) for name in self.specs}
        self.children: dict[str, Child] = {}
        self.meters = {name: Meter() for name in self.specs}
        self.facts: dict[str, Any] = {}
        self.told: dict[str, Any] = {}
        self.stats: dict[str, dict[str, Any]] = {name: {} for name in self.specs}
        self.changed = True
        self._selector = selector
        self._teller: dict[str, str] = {}
        self._ready: set[str] = set()
        self._heard: dict[str, float] = {}
        self._loading: dict[str, float] = {}
        self._exits: dict[str, Exit] = {}
        self._restarts: set[str] = set()

    @property
    def alive(self) -> list[str]:
        return [name for name, life in self.lives.items() if life.state in ALIVE]

    def ask_restart(self, name: str) -> None:
        """Raises KeyError when there is no such process."""
        self._restarts.add(self.specs[name].name)
        self.changed = True

    def reconcile(self, orders: Orders, now: float) -> None:
        """One round: reap, then a step for every process, again while something changed (an order of starts is a chain)."""
        for _ in range(2 + len(self.specs)):
            self.changed = False
            self._loading = {
                name: until for name, until in self._loading.items() if until > now and name in self.children
            }
            self._reap(now)
            for name, spec in self.specs.items():
                self._step(spec, self._see(name, spec, orders, now), now)
            if not self.changed:
                return

    def sample(self, now: float) -> None:
        """CPU and memory of all, about once a second."""
        for name, child in self.children.items():
            self.meters[name].sample(child.pid, now)

    def cut_logs(self, now: float) -> None:
        for name, child in self.children.items():
            if child.cut_log() and child.cut == 1:
                limit = child_process.LOG_LIMIT_BYTES >> 20
                self.journal.event(
                    now,
                    name,
                    f"its log passed {limit} MiB and was cut: it keeps its first MiB and the newest lines",
                )

    def members(self) -> dict[str, Member]:
        """For state.json."""
        return {n: Member(pid=c.pid, pgid=c.pid, start_s=c.start_s) for n, c in self.children.items()}

    def _see(self, name: str, spec: ProcessSpec, orders: Orders, now: float) -> Seen:
        life = self.lives[name]
        exit = self._exits.pop(name, None)
        stopped = name in self.children and self.children[name].stopped != ""
        if (
            life.state is State.READY
            and exit is None
            and not (stopped or orders.stop or orders.kill or self._restarts)
        ):
            return _NOTHING if spec.silent_for_s is None else Seen(silent_s=now - self._heard.get(name, now))
        needs = [(self.specs[n], self.lives[n]) for n in spec.needs if n in self.specs]
        restart = name in self._restarts
        self._restarts.discard(name)
        # Only first starts queue: what is started again in flight is needed now.
        may_load = life.started > 0 or len(self._loading) < AT_ONCE
        return Seen(
            needs_ready=may_load and all(shutdown_policy.is_served(*need) for need in needs),
            needs_dead=next((need.name for need, its in needs if shutdown_policy.is_dead(need, its)), ""),
            proof=self._proof(name, spec) if life.state is State.STARTING and exit is None else "",
            exit=exit,
            stopped=stopped,
            starts_on=orders.starts_on,
            stop=name in orders.stop,
            kill=name in orders.kill,
            restart=restart,
            why="restart asked" if restart and orders.starts_on else orders.why,
        )

    def _proof(self, name: str, spec: ProcessSpec) -> str:
        if spec.ready == "told":
            return "it says so" if name in self._ready else ""
        if spec.ready == "started":
            return "started" if name in self.children else ""
        served = name in self.children and proc_fs.serves_port(self.children[name].pid, spec.ready_port)
        return f"serves port {spec.ready_port}" if served else ""

    def _step(self, spec: ProcessSpec, seen: Seen, now: float) -> None:
        before = self.lives[spec.name]
        life, action = step(spec, before, seen, now)
        self.lives[spec.name] = life
        if (life.stopped_at is None) is not (before.stopped_at is None):
            self._tell_stopped(spec, before, life, now)
        if life.state is not before.state:
            self.journal.transition(now, spec.name, before.state, life.state, life.reason)
            self.changed = True
            if life.exit is not None and before.state in (State.STARTING, State.READY):
                self._tell_last_words(spec.name, life.exit, now)
        match action:
            case Action.START:
                self._start(spec, now)
            case Action.TERMINATE:
                self._signal(spec.name, signal.Signals[spec.stop_signal])
                self._signal(spec.name, signal.SIGCONT)  # one that is stopped would not hear of it
            case Action.KILL:
                self._signal(spec.name, signal.SIGKILL)
                if life.state is before.state:
                    self.journal.event(
                        now, spec.name, f"did not end within {spec.stop_timeout_s:g} s: SIGKILL"
                    )

    def _tell_stopped(self, spec: ProcessSpec, before: Life, life: Life, now: float) -> None:
        child = self.children.get(spec.name)
        if child is not None and life.stopped_at is not None:
            limit_s = spec.stopped_for_s
            what = "it is left alone" if limit_s is None else f"it is killed if it stays so for {limit_s:g} s"
            self.journal.event(
                now,
                spec.name,
                f"stopped by {child.stopped}; {what}, and `kill -CONT {child.pid}` lets it go on",
            )
        elif child is not None and before.stopped_at is not None:
            self.journal.event(now, spec.name, f"goes on after {now - before.stopped_at:.1f} s")

    def _tell_last_words(self, name: str, exit: Exit, now: float) -> None:
        """Of a process that failed: the end of its log is what a person would look for."""
        if exit.code and exit.ran and (line := last_line(self.folder.log(name))):
            self.journal.event(now, name, f"its last words: {line}")

    def _signal(self, name: str, number: int) -> None:
        if name in self.children:
            self.children[name].signal(number)

    def _start(self, spec: ProcessSpec, now: float) -> None:
        self.changed = True
        self._ready.discard(spec.name)
        self._heard.pop(spec.name, None)
        try:
            child = child_process.start(
                self.folder.spec(spec), self.folder.log(spec.name), str(self.folder.path)
            )
        except (OSError, ValueError) as error:
            what = getattr(error, "strerror", None) or str(error)
            where = getattr(error, "filename", None) or spec.argv[0]
            self._exits[spec.name] = Exit(code=127, words=f"could not start: {where}: {what}", ran=False)
            return
        self.children[spec.name] = child
        self._loading[spec.name] = now + (_LOADING_S if spec.ready == "told" else _SILENT_LOADING_S)
        self.meters[spec.name].started(now)
        if child.line is not None:
            self._selector.register(child.line, selectors.EVENT_READ, lambda: self._hear(child))

    def _hear(self, child: Child) -> None:
        line, garbage, name = child.line, child.garbage, child.spec.name
        if line is None:
            return
        fd = line.fileno()
        for packet in child.hear():
            self._take(name, packet)
        now = time.monotonic()
        if child.line is None:
            self._selector.unregister(fd)
        if child.garbage and not garbage:
            self.journal.event(
                now, name, "sent something on its line that is not a JSON object: ignored, counted"
            )

    def _take(self, name: str, packet: Mapping[str, Any]) -> None:
        self._heard[name] = time.monotonic()
        if packet.get("entered") is True or packet.get("ready") is True:
            self.changed = self._loading.pop(name, None) is not None or self.changed
        if packet.get("ready") is True and name not in self._ready:
            self._ready.add(name)
            self.changed = True
        if isinstance(facts := packet.get("facts"), dict):
            self._take_facts(name, facts)
        if isinstance(stats := packet.get("stats"), dict) and len(self.stats[name]) < _MOST_NAMES:
            self.stats[name].update(stats)
        if isinstance(event := packet.get("event"), str):
            self.journal.event(time.monotonic(), name, event)

    def _take_facts(self, name: str, facts: dict[str, Any]) -> None:
        """A program may not say what is armed: landing depends on it."""
        program = self.specs[name].kind == "program"
        for key, value in facts.items():
            if len(self.told) >= _MOST_NAMES or (program and key.endswith((".armed", ".landed"))):
                continue
            self.changed = self.changed or self.facts.get(key) != value
            self.facts[key] = self.told[key] = value
            self._teller[key] = name

    def _reap(self, now: float) -> None:
        for name, child in list(self.children.items()):
            if (exit := child.reap()) is not None:
                self._bury(name, child, exit, now)

    def _bury(self, name: str, child: Child, exit: Exit, now: float) -> None:
        """Its last words, its CPU, and its facts, which nobody vouches for any more."""
        self._hear(child)
        if child.line is not None:
            self._selector.unregister(child.line)
            child.close()
        del self.children[name]
        self.meters[name].ended(child.cpu_s, now)
        for key in [key for key, teller in self._teller.items() if teller == name]:
            del self._teller[key]
            self.facts.pop(key, None)
        self._exits[name] = exit
        self.changed = True

    def table(self, now: float) -> dict[str, dict[str, Any]]:
        """Every process as `arena ps`, the live table and outcome.json show it."""
        return {name: self._row(name, spec, now) for name, spec in self.specs.items()}

    def _row(self, name: str, spec: ProcessSpec, now: float) -> dict[str, Any]:
        life, meter = self.lives[name], self.meters[name]
        child = self.children.get(name)
        return {
            "kind": spec.kind,
            "vehicle": spec.vehicle,
            "state": str(life.state),
            "reason": life.reason,
            "exit_code": life.exit.code if life.exit else None,
            "exit": life.exit.words if life.exit else None,
            "pid": child.pid if child else None,
            "starts": life.started,
            "restarts": life.restarts,
            "alive_s": round(meter.alive_s(now), 3),
            "cpu_s": round(meter.cpu_s, 3),
            "cpu_mean": round(meter.cpu_mean(now), 4),
            "cpu_now": round(meter.now_cpu, 4),
            "rss_mb": round(meter.now_mb, 1),
            "rss_peak_mb": round(meter.peak_mb, 1),
            "over_budget": meter.over_budget(spec, now),
            "stats": self.stats[name],
        }


_NOTHING = Seen()
