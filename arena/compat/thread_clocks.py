"""Separate clock for each thread of a program, so that each thread can sleep in simulation time."""

from __future__ import annotations

import threading
import time

from arena.clock import Clock, SimClock, SimTime, WallClock
from arena.compat import command_line

_of_thread = threading.local()


def use(clock: Clock) -> Clock:
    """Make a clock that of this thread, unless the thread already has one. Return the thread's clock.

    In lockstep the world waits for every clock that does not sleep, so a thread must not have two.
    """
    own = getattr(_of_thread, "clock", None)
    if own is None:
        _of_thread.clock = own = clock
    elif isinstance(clock, SimClock) and clock is not own:
        clock.close()
    return own


def clock() -> Clock:
    """Return the clock of this thread. The first call creates the clock."""
    own: Clock | None = getattr(_of_thread, "clock", None)
    if own is None:
        path = command_line.clock_path()
        name = f"{command_line.vehicle_name()} {threading.current_thread().name}"
        own = use(WallClock() if path is None else SimClock(path, name))
    return own


def time_s() -> float:
    """Return the simulation time [s], or the Unix time [s] if the program uses the wall clock."""
    path = command_line.clock_path()
    if path is None:
        return time.time()
    if not hasattr(_of_thread, "time"):
        _of_thread.time = SimTime(path)
    return float(_of_thread.time.now())
