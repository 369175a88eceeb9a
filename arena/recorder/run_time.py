"""Clocks of the recorder: simulation time, or Unix time if at least one vehicle is real."""

from __future__ import annotations

import time
from typing import Protocol

from arena.clock import SimClock
from arena.clock_reading import read_together

# Each wake-up costs CPU time, also without data. Sockets and truth page hold the data of more than 0.2 s.
_LONGEST_PERIOD_S = 0.1
# A live viewer shows the data of a period at once. A full socket buffer of a process without privileges holds about 330 datagrams.
_SHORTEST_PERIOD_S = 0.04
_PERIOD_PER_VEHICLE_S = 0.2  # by the number of vehicles: 35 datagrams at the usual rates
# Arrival times are interpolated between two wake-ups. In lockstep the speed of the simulation is not constant.
_LOCKSTEP_PERIOD_S = 0.02
_MAX_WAIT_S = 0.25  # wall time: events, disk and supervisor are served also while the simulation stands still


def wake_period_s(vehicles: int, *, live: bool) -> float:
    """Return the period [s] at which the recorder wakes up and reads its sockets.

    live: a viewer may receive the messages during the flight.
    """
    if live:
        return _SHORTEST_PERIOD_S
    return min(_LONGEST_PERIOD_S, max(_SHORTEST_PERIOD_S, _PERIOD_PER_VEHICLE_S / vehicles))


class RunTime(Protocol):
    """Interface of the clock of a run."""

    def now(self) -> float:
        """Return the present time by the run's clock [s]."""

    def wait(self) -> None:
        """Wait until the current period ends. While the simulation stands still, wait at most 0.25 s of wall time.

        Raises RunError if the simulated world has ended.
        """


class SimulationTime:
    """Clock of a run in simulation time.

    In lockstep, the world does not advance beyond the end of the period before `wait` is called again.

    path, name: path of the simulation clock, and name of this client.  period_s: time between two wake-ups [s], except in lockstep.
    """

    def __init__(self, path: str, name: str, period_s: float) -> None:
        self._clock = SimClock(path, name)
        self.now = self._clock.now
        self._period_s = _LOCKSTEP_PERIOD_S if self._clock.lockstep else period_s
        self._next_s, self._requested = self.now() + self._period_s, False

    def wait(self) -> None:
        if not self._requested:
            self._clock.request_wake(self._next_s)
        now_s = self._clock.wait_for_wake(_MAX_WAIT_S)
        self._requested = now_s is None
        if now_s is not None:
            self._next_s = max(self._next_s + self._period_s, now_s)


class UnixTime:
    """Clock of a run in Unix time. A later change of the system's clock does not affect it.

    period_s: time between two wake-ups [s].
    """

    def __init__(self, period_s: float) -> None:
        unix_s, monotonic_s = read_together(time.time)
        self._offset_s = unix_s - monotonic_s
        self._period_s = period_s
        self._next_s = time.monotonic() + period_s

    def now(self) -> float:
        return time.monotonic() + self._offset_s

    def wait(self) -> None:
        time.sleep(max(0.0, self._next_s - time.monotonic()))
        self._next_s = max(self._next_s + self._period_s, time.monotonic())
