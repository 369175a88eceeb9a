"""Measurements of a run: CPU and memory of each process, and the real-time factor of the world."""

from __future__ import annotations

import time
from dataclasses import dataclass

from arena.clock import SimTime
from arena.errors import RunError
from arena.plan.model import Plan, ProcessSpec
from arena.supervisor import proc_fs
from arena.supervisor.run_folder import RunFolder

_LEAST_S = 3.0
"""Shortest time over which the real-time factor is reported [s]."""


class RealTimeMeter:
    """Meter of a run's simulated time and real-time factor (simulated seconds per wall second)."""

    def __init__(self, plan: Plan, folder: RunFolder) -> None:
        world = plan.slices.get("world.json") or plan.slices.get("replay.json", {})
        stem, asked = world.get("clock"), world.get("speed", 1.0)
        self._stem = folder.fill(stem) if isinstance(stem, str) else None
        self._asked = float(asked) if isinstance(asked, int | float) else None
        self._clock: SimTime | None = None
        self._began = time.monotonic()
        self._measures = not plan.is_replay  # a replay can be paused and moved
        self._first: tuple[float, float] | None = None
        self._last = (0.0, 0.0)

    def time_s(self) -> float | None:
        """Return the simulated time [s], or None before the world runs.

        Without a simulated world, it is the time since the start [s].
        """
        if self._stem is None:
            return time.monotonic() - self._began
        try:
            self._clock = self._clock or SimTime(self._stem)
        except RunError:
            return None
        return self._clock.now() or None

    def sample(self, now: float) -> None:
        """Store a sample of the simulated time. `result` computes the real-time factor from the samples.

        Called about once a second while the
        world runs. now: monotonic [s].
        """
        if self._measures and self._stem is not None and (time_s := self.time_s()) is not None:
            self._first = self._first or (now, time_s)
            self._last = (now, time_s)

    def result(self) -> dict[str, float | None] | None:
        """Return the run's mean real-time factor (`factor`) and the requested real-time factor (`asked`).

        `asked` is None if the simulation runs as fast as possible. Return None if too little was measured.
        """
        if self._first is None or (wall_s := self._last[0] - self._first[0]) < _LEAST_S:
            return None
        return {"factor": round((self._last[1] - self._first[1]) / wall_s, 3), "asked": self._asked}


@dataclass(kw_only=True)
class Meter:
    """Meter of CPU time and memory of one process and its descendants.

    now_cpu: CPU use since the sample before, as a fraction of one core [-].
    now_mb: resident memory [MB].  peak_mb: maximum of the resident memory [MB].
    """

    now_cpu: float = 0.0
    now_mb: float = 0.0
    peak_mb: float = 0.0
    _past_cpu_s: float = 0.0
    _past_alive_s: float = 0.0
    _cpu_s: float = 0.0
    _since: float | None = None
    _sampled_at: float = 0.0

    @property
    def cpu_s(self) -> float:
        """Total CPU time of the process, summed over its restarts [s]."""
        return self._past_cpu_s + self._cpu_s

    def alive_s(self, now: float) -> float:
        """Return the total running time of the process, summed over its restarts [s].

        now: monotonic [s].
        """
        return self._past_alive_s + (now - self._since if self._since is not None else 0.0)

    def cpu_mean(self, now: float) -> float:
        """Return the mean CPU use while the process ran, as a fraction of one core [-].

        now: monotonic [s].
        """
        return self.cpu_s / alive if (alive := self.alive_s(now)) > 0 else 0.0

    def started(self, now: float) -> None:
        """Record that the process was started.

        now: monotonic [s].
        """
        self._since = self._sampled_at = now

    def sample(self, pid: int, now: float) -> None:
        """Measure CPU and memory of the process and its descendants.

        now: monotonic [s].
        """
        used = [u for member in proc_fs.tree(pid) if (u := proc_fs.usage(member)) is not None]
        cpu_s = max(self._cpu_s, sum(u.cpu_s for u in used))
        if now > self._sampled_at:
            self.now_cpu = (cpu_s - self._cpu_s) / (now - self._sampled_at)
        self.now_mb = sum(u.rss_mb for u in used)
        self.peak_mb = max(self.peak_mb, self.now_mb)
        self._cpu_s, self._sampled_at = cpu_s, now

    def ended(self, cpu_s: float, now: float) -> None:
        """Record that the process ended.

        cpu_s: its CPU time, as the kernel reported at the end [s].
        now: monotonic [s].
        """
        self._past_cpu_s += max(self._cpu_s, cpu_s)
        self._past_alive_s += now - self._since if self._since is not None else 0.0
        self._cpu_s, self._since, self.now_cpu, self.now_mb = 0.0, None, 0.0, 0.0

    def over_budget(self, spec: ProcessSpec, now: float) -> list[str]:
        """Return one text for each limit that the process has exceeded: `cpu_budget`, `memory_budget_mb`.

        now: monotonic [s].
        """
        found = []
        if (mean := self.cpu_mean(now)) > spec.cpu_budget and self.alive_s(now) > 1.0:
            found.append(f"CPU {mean:.2f} of a core, budget {spec.cpu_budget:g}")
        if self.peak_mb > spec.memory_budget_mb:
            found.append(f"memory {self.peak_mb:.0f} MB, budget {spec.memory_budget_mb:g} MB")
        return found
