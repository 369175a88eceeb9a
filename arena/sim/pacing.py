"""Keeping a stepped world at the wall clock's pace, and telling how well that goes. Pure: `now` comes in,
waits come out.

Deadlines are absolute, so an error never adds up. A debt above 20 ms is forgiven: a world that has stood
still does not then rush to catch up under programs that live on the wall clock; the deadlines move, and how
often and how far is counted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

FORGIVEN_ABOVE_S = 0.020
_BIN_S = 1e-4
_BINS = 1000
_WINDOW_S = 1.0


@dataclass(kw_only=True)
class Lateness:
    """How late steps began, in a histogram of fixed size: 0.1 ms bins, the last one open."""

    worst_s: float = 0.0
    steps: int = 0
    _bins: list[int] = field(default_factory=lambda: [0] * _BINS, repr=False)

    def add(self, late_s: float) -> None:
        late_s = max(0.0, late_s)
        self.steps += 1
        self.worst_s = max(self.worst_s, late_s)
        self._bins[min(int(late_s / _BIN_S), _BINS - 1)] += 1

    def percentile(self, percent: float) -> float:
        """The upper edge of the bin below which `percent` of the steps lie [s]; 0 before the first."""
        wanted, seen = self.steps * percent / 100.0, 0
        for i, count in enumerate(self._bins):
            seen += count
            if count and seen >= wanted:
                return self.worst_s if i == _BINS - 1 else min((i + 1) * _BIN_S, self.worst_s)
        return 0.0


class Pacer:
    """speed: simulated seconds per second of wall time, or inf for as fast as it goes. period_s: simulated
    time per step.

    The loop asks `wait_s(now)` until it is not positive, calls `begin(now)`, and steps.
    rtf: real-time factor of the last full second of wall time; rtf_min and rtf_max over all of them; nan
    before the first.
    """

    def __init__(self, *, period_s: float, speed: float, now: float) -> None:
        self._sim_s, self._wall_s = period_s, period_s / speed
        self._deadline = now + self._wall_s
        self.lateness = Lateness()
        self.forgiven, self.forgiven_s = 0, 0.0
        self.rtf, self.rtf_min, self.rtf_max = math.nan, math.inf, -math.inf
        self._window_from, self._window_steps = now, 0

    def wait_s(self, now: float) -> float:
        """Wall time left before the next step may begin [s]."""
        return self._deadline - now

    def begin(self, now: float) -> None:
        """A step begins now: note how late, forgive a debt, move on to the next deadline, close the second's
        window.
        """
        if self._wall_s > 0.0:
            self._note(now)
        self._window_steps += 1
        if now - self._window_from >= _WINDOW_S:
            self._close_window(now)

    def _note(self, now: float) -> None:
        late = now - self._deadline
        self.lateness.add(late)
        if late > FORGIVEN_ABOVE_S:
            self.forgiven, self.forgiven_s = self.forgiven + 1, self.forgiven_s + late
            self._deadline = now
        self._deadline += self._wall_s

    def _close_window(self, now: float) -> None:
        self.rtf = self._window_steps * self._sim_s / (now - self._window_from)
        self.rtf_min, self.rtf_max = min(self.rtf_min, self.rtf), max(self.rtf_max, self.rtf)
        self._window_from, self._window_steps = now, 0

    def stats(self) -> dict[str, float | int | None]:
        """For the room's stats: times in ms; the factors are None before the first full second."""
        known = not math.isnan(self.rtf)
        late = self.lateness
        return {
            "lateness_p99_ms": round(1e3 * late.percentile(99.0), 2),
            "lateness_worst_ms": round(1e3 * late.worst_s, 2),
            "rtf": round(self.rtf, 4) if known else None,
            "rtf_min": round(self.rtf_min, 4) if known else None,
            "rtf_max": round(self.rtf_max, 4) if known else None,
            "forgiven": self.forgiven,
            "forgiven_ms": round(1e3 * self.forgiven_s, 1),
        }


def speed_of(value: float | str) -> float:
    """The slice's `speed`, a number or "max", as a float: inf for max."""
    return math.inf if value == "max" else float(value)


def own_core(cores: Sequence[int], *, speed: float, outside: int, pid: int) -> int | None:
    """The core that a world keeps to while it hurries with few autopilots in processes of their own; else None.

    Each step is a turn of the world's, then theirs: on two cores they overlap, and a world that stays where it is finds its
    caches warm. Worth it only where every one of them has a core too. pid: so that several worlds do not choose the same.
    """
    if speed == 1.0 or outside == 0 or outside >= len(cores):
        return None
    return sorted(cores)[pid % len(cores)]
