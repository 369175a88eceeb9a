"""Kernel links between Linux processes (prctl): a signal when the parent dies, a new parent for orphans.

Standard library only.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 1, 36, 37
_libc = ctypes.CDLL(None)


def set_death_signal(number: int) -> None:
    """Ask the kernel to send a signal to this process when its parent dies.

    A parent that has died before this call is not noticed: compare `os.getppid()` after it.
    """
    _libc.prctl(_PR_SET_PDEATHSIG, number, 0, 0, 0)


def adopt_orphans() -> None:
    """Make this process the new parent of its descendants whose own parent has died (child subreaper)."""
    _libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


@contextlib.contextmanager
def adopting_orphans() -> Iterator[None]:
    """Make this process the new parent of orphaned descendants during a `with` block."""
    before = ctypes.c_int()
    _libc.prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(before), 0, 0, 0)
    adopt_orphans()
    try:
        yield
    finally:
        _libc.prctl(_PR_SET_CHILD_SUBREAPER, before.value, 0, 0, 0)
