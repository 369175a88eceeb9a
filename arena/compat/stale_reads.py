"""Check of the values from which a program computes a setpoint: a value that is too old must not become a motion."""

from __future__ import annotations

import threading

from arena.errors import StaleDataError

LIMIT_S = 1.0
"""Age above which a value must not become a setpoint [s]. The offboard failsafe of the autopilot has the same limit."""


class StaleReads(threading.local):
    """Values that were too old when the program read them. Each thread has its own, because a log thread may read old values."""

    def __init__(self) -> None:
        self._found: dict[str, str] = {}

    def note(self, name: str, why: str) -> None:
        """Store a value that was too old. name: such as `ekf.pos`.  why: the age, as text; "" if it was not too old."""
        self._found.pop(name, None)
        if why:
            self._found[name] = why

    def clear(self) -> None:
        """Forget all values that were read before."""
        self._found.clear()

    def check(self) -> None:
        """Raise StaleDataError if this thread has read a value that was too old since the last call."""
        if self._found:
            why = next(iter(self._found.values()))
            self.clear()
            raise StaleDataError(f"no setpoint is sent, because the program has read an old value: {why}")
