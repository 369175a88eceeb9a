"""Samples the true states of the simulated vehicles at a fixed rate, from shared memory (the truth page)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from arena.wire.truth_rows import TrueStates

_EARLY_S = 1e-6  # simulation time advances in steps, which are not exact in binary
_DRIFT = 0.1  # by which the world may be slower than real time, in an arena with real vehicles
_MAX_SAMPLES = 250  # per call: after a stall the older samples are no longer in the page


class _Reader(Protocol):
    def at(self, time_s: float, /) -> TrueStates | None: ...

    def newest(self) -> TrueStates | None: ...


class TruthSampler:
    """Reader that samples the true states of the simulated vehicles at a fixed rate.

    reader: reader of the truth page.  rate_hz: samples per second [Hz].
    simulation_clock: the run's clock is simulation time. Else it is Unix time, to which simulation time is converted.
    """

    def __init__(self, reader: _Reader, rate_hz: float, *, simulation_clock: bool) -> None:
        self._reader, self._rate_hz, self._simulation_clock = reader, rate_hz, simulation_clock
        self._next: int | None = None
        self._offset_s, self._at_s = math.inf, 0.0

    def due(self, now_s: float) -> Sequence[tuple[float, TrueStates]]:
        """Return (time, true states) for each sampling time since the last call.

        now_s: run's clock [s].
        """
        offset_s = 0.0 if self._simulation_clock else self._offset(now_s)
        if offset_s is None:
            return ()
        last = math.floor((now_s + _EARLY_S) * self._rate_hz)
        if self._next == last + 1:
            return ()
        first = last if self._next is None else max(self._next, last - _MAX_SAMPLES)
        self._next = last + 1
        found = []
        for number in range(first, last + 1):
            time_s = number / self._rate_hz
            truth = self._reader.at(time_s - offset_s) or (self._reader.newest() if number == last else None)
            if truth is not None:
                found.append((time_s, truth))
        return found

    def _offset(self, now_s: float) -> float | None:
        """Return the difference Unix time minus simulation time [s].

        The smallest observed difference is used, because a sample is read some time after it was written.
        """
        newest = self._reader.newest()
        if newest is None:
            return None
        found = now_s - newest.time_s
        self._offset_s = min(found, self._offset_s + _DRIFT * (now_s - self._at_s))
        self._at_s = now_s
        return self._offset_s
