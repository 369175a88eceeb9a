"""CPU and memory of one process of the plan, over all its starts."""

from __future__ import annotations

from dataclasses import dataclass

from arena.plan.model import ProcessSpec
from arena.supervisor import proc_fs


@dataclass(kw_only=True)
class Meter:
    """now_cpu: fraction of a core over the last sample [-].  peak_mb: the most ever resident, with descendants [MB]."""

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
        """CPU time used [s]."""
        return self._past_cpu_s + self._cpu_s

    def alive_s(self, now: float) -> float:
        return self._past_alive_s + (now - self._since if self._since is not None else 0.0)

    def cpu_mean(self, now: float) -> float:
        """Fraction of a core while it was alive [-]."""
        return self.cpu_s / alive if (alive := self.alive_s(now)) > 0 else 0.0

    def started(self, now: float) -> None:
        self._since = self._sampled_at = now

    def sample(self, pid: int, now: float) -> None:
        used = [u for member in proc_fs.tree(pid) if (u := proc_fs.usage(member)) is not None]
        cpu_s = max(self._cpu_s, sum(u.cpu_s for u in used))
        if now > self._sampled_at:
            self.now_cpu = (cpu_s - self._cpu_s) / (now - self._sampled_at)
        self.now_mb = sum(u.rss_mb for u in used)
        self.peak_mb = max(self.peak_mb, self.now_mb)
        self._cpu_s, self._sampled_at = cpu_s, now

    def ended(self, cpu_s: float, now: float) -> None:
        """cpu_s: the kernel's own account at the end of the process [s]."""
        self._past_cpu_s += max(self._cpu_s, cpu_s)
        self._past_alive_s += now - self._since if self._since is not None else 0.0
        self._cpu_s, self._since, self.now_cpu, self.now_mb = 0.0, None, 0.0, 0.0

    def over_budget(self, spec: ProcessSpec, now: float) -> list[str]:
        """Budgets exceeded, in words."""
        found = []
        if (mean := self.cpu_mean(now)) > spec.cpu_budget and self.alive_s(now) > 1.0:
            found.append(f"CPU {mean:.2f} of a core, budget {spec.cpu_budget:g}")
        if self.peak_mb > spec.memory_budget_mb:
            found.append(f"memory {self.peak_mb:.0f} MB, budget {spec.memory_budget_mb:g} MB")
        return found
