"""Pacing of the simulation steps against the wall clock, and statistics of their delays. Pure.

Deadlines are absolute, so errors do not accumulate. A delay above 20 ms is skipped: the deadlines move by the
delay, and the number and sum of the skipped delays are counted. Otherwise a world that was stopped would
catch up in a burst, which disturbs programs that use the wall clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

MAX_DELAY_S = 0.020
"""Longest delay that later steps catch up with; longer ones are skipped [s]."""
_BIN_S = 1e-4
_BINS = 1000
_WINDOW_S = 1.0


@dataclass(kw_only=True)
class Lateness:
    """Histogram of the step delays in bins of 0.1 ms. The last bin has no upper limit."""

    worst_s: float = 0.0
    steps: int = 0
    _bins: list[int] = field(default_factory=lambda: [0] * _BINS, repr=False)

    def add(self, late_s: float) -> None:
        """Add the delay of one step to the histogram.

        late_s: delay after its deadline [s]
        """
        late_s = max(0.0, late_s)
        self.steps += 1
        self.worst_s = max(self.worst_s, late_s)
        self._bins[min(int(late_s / _BIN_S), _BINS - 1)] += 1

    def percentile(self, percent: float) -> float:
        """Return a percentile of the step delays [s], or 0 before the first step.

        It is the upper edge of a bin.

        percent: share of the steps that are at most this late [%]
        """
        wanted, seen = self.steps * percent / 100.0, 0
        for i, count in enumerate(self._bins):
            seen += count
            if count and seen >= wanted:
                return self.worst_s if i == _BINS - 1 else min((i + 1) * _BIN_S, self.worst_s)
        return 0.0


class Pacer:
    """Pacer of the step loop: it computes when each step may begin, and measures the real-time factor.

    For each step the loop waits until `wait_s(now)` is not positive, then calls `begin(now)`.

    period_s: simulated time of a step [s]
    speed: simulated seconds per second of wall time; inf for as fast as possible
    now: wall time [s]
    rtf: real-time factor in the last full second of wall time [-], NaN before the first
    rtf_min, rtf_max: smallest and largest `rtf` so far [-]
    rtf_min_sim_s: simulated time in the middle of the second with `rtf_min` [s], NaN before the first full second
    skipped, skipped_s: number and sum of the skipped delays [s]
    """

    def __init__(self, *, period_s: float, speed: float, now: float) -> None:
        self._sim_s, self._wall_s = period_s, period_s / speed
        self._deadline = now + self._wall_s
        self.lateness = Lateness()
        self.skipped, self.skipped_s = 0, 0.0
        self.rtf, self.rtf_min, self.rtf_max = math.nan, math.inf, -math.inf
        self.rtf_min_sim_s = math.nan
        self._window_from, self._window_steps, self._steps = now, 0, 0

    def wait_s(self, now: float) -> float:
        """Return the wall time left before the next step may begin [s]."""
        return self._deadline - now

    def begin(self, now: float) -> None:
        """Begin a step: record its delay, set the next deadline, and update `rtf`.

        After a long delay, the lost time is not made up.
        """
        if self._wall_s > 0.0:
            self._record(now)
        self._window_steps += 1
        self._steps += 1
        if now - self._window_from >= _WINDOW_S:
            self._close_window(now)

    def _record(self, now: float) -> None:
        late = now - self._deadline
        self.lateness.add(late)
        if late > MAX_DELAY_S:
            self.skipped, self.skipped_s = self.skipped + 1, self.skipped_s + late
            self._deadline = now
        self._deadline += self._wall_s

    def _close_window(self, now: float) -> None:
        self.rtf = self._window_steps * self._sim_s / (now - self._window_from)
        if self.rtf < self.rtf_min:
            self.rtf_min, self.rtf_min_sim_s = (
                self.rtf,
                (self._steps - 0.5 * self._window_steps) * self._sim_s,
            )
        self.rtf_max = max(self.rtf_max, self.rtf)
        self._window_from, self._window_steps = now, 0

    def stats(self) -> dict[str, float | int | None]:
        """Return the statistics of the steps: delays [ms], real-time factors [-], slowest simulated second [s].

        The factors are None before the first full second.
        """
        known = not math.isnan(self.rtf)
        late = self.lateness
        return {
            "lateness_p99_ms": round(1e3 * late.percentile(99.0), 2),
            "lateness_worst_ms": round(1e3 * late.worst_s, 2),
            "rtf": round(self.rtf, 4) if known else None,
            "rtf_min": round(self.rtf_min, 4) if known else None,
            "rtf_min_sim_s": round(self.rtf_min_sim_s, 3) if known else None,
            "rtf_max": round(self.rtf_max, 4) if known else None,
            "skipped": self.skipped,
            "skipped_ms": round(1e3 * self.skipped_s, 1),
        }


def own_core(cores: Sequence[int], *, speed: float, external: int, pid: int) -> int | None:
    """Return the CPU core to which the world process is pinned, or None if it may use any core.

    cores: cores that the process may use
    speed: simulated seconds per second of wall time
    external: number of autopilots in processes of their own
    pid: process id of the world; it makes several worlds choose different cores

    Faster than real time, the world and its external autopilots compute in turns. On two cores these turns
    overlap, and a world that stays on one core keeps its caches. This helps only if every autopilot has a
    core too.
    """
    if speed == 1.0 or external == 0 or external >= len(cores):
        return None
    return sorted(cores)[pid % len(cores)]
