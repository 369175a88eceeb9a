"""CPU core on which two processes that work in turns wait for each other.

The kernel wakes a process on an idle core if it may. A wake-up on another core costs an interrupt between cores and finds cold caches:
in an arena of one vehicle, faster than real time, this was a quarter of all CPU time on a virtual machine. So the world and its only
program wait on the same core. Only the waiting thread is kept there, and only while it waits: a program can compute on all cores.
"""

from __future__ import annotations

import contextlib
import ctypes
import os

_libc = ctypes.CDLL(None)
NO_CORE = -1
"""Instead of a core: the process may wait on any core. `sched_getcpu` also returns it on an error."""
Cores = set[int]


def present_core() -> int:
    """Return the number of the core on which the calling thread runs, or NO_CORE if it may use one core only."""
    if len(os.sched_getaffinity(0)) < 2:
        return NO_CORE
    return int(_libc.sched_getcpu())


def stay_on(core: int) -> Cores | None:
    """Keep the calling thread on a core until `leave` is called. Return the argument of `leave`.

    core: number of the core. Nothing changes, and the result is None, if it is NO_CORE, or the only core that the thread may use, or
        one that it may not use.
    """
    if core == NO_CORE:
        return None
    cores = os.sched_getaffinity(0)
    if core not in cores or len(cores) < 2:
        return None
    try:
        os.sched_setaffinity(0, (core,))
    except OSError:  # the core is switched off
        return None
    return cores


def leave(cores: Cores | None) -> None:
    """Undo `stay_on`. cores: its result"""
    if cores is not None:
        with contextlib.suppress(OSError):  # all of them are switched off, or forbidden by now
            os.sched_setaffinity(0, cores)
