"""Conversion of monotonic times to the time of a run (simulation time or Unix time). Pure."""

from __future__ import annotations

from collections import deque


class RunClock:
    """Converter from the monotonic time of a recent event, such as a received datagram, to the run's time.

    It interpolates between the last times at which both clocks were read, and never returns a time outside of them. In a
    simulation that runs at another speed than real time, or stops, the result is late or early by less than the time between
    two readings.

    run_s: the run's clock [s].  monotonic_s: monotonic time at the same instant [s].
    readings: number of readings that are kept. A time before all of them is converted to the oldest reading of the run's clock.
    """

    def __init__(self, run_s: float, monotonic_s: float, readings: int = 2) -> None:
        self._readings = deque([(run_s, monotonic_s)], maxlen=readings)

    def update(self, run_s: float, monotonic_s: float) -> None:
        """Store the run's time and the monotonic time of the same instant.

        Call it before the data that have arrived are read.
        """
        self._readings.append((run_s, monotonic_s))

    def at(self, monotonic_s: float) -> float:
        """Convert a monotonic time [s] to the run's time [s]."""
        newer = reversed(self._readings)
        run_1, at_1 = next(newer)
        if monotonic_s >= at_1:
            return run_1
        for run_0, at_0 in newer:
            if monotonic_s >= at_0:
                return run_0 + (run_1 - run_0) * (monotonic_s - at_0) / (at_1 - at_0)
            run_1, at_1 = run_0, at_0
        return run_1
