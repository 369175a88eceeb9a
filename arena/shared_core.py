"""Keeps two processes that work in turns on one CPU core while they wait for each other.

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
Cores = set[int]


def present_core() -> int:
    """Return the number of the core on which the calling thread runs; NO_CORE if it may not use another one, or on an error."""
    if len(os.sched_getaffinity(0)) < 2:
        return NO_CORE
    return int(_libc.sched_getcpu())


def stay_on(core: int) -> Cores | None:
    """Limit the calling thread to this core, until `leave`. Return the cores that it may use otherwise.

    Return None, and change nothing, if it may not use this core, or no other one.
    """
    cores = os.sched_getaffinity(0)
    if core not in cores or len(cores) < 2:
        return None
    try:
        os.sched_setaffinity(0, (core,))
    except OSError:  # the core is switched off
        return None
    return cores


def leave(cores: Cores | None) -> None:
    """Allow the calling thread the cores that `stay_on` returned; None: change nothing."""
    if cores is not None:
        with contextlib.suppress(OSError):  # all of them are switched off, or forbidden by now
            os.sched_setaffinity(0, cores)
