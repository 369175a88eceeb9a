"""Check of a user program: it must not compute its setpoints from outdated telemetry.

A value that is too old must not move a vehicle.
"""

from __future__ import annotations

import threading

from arena.errors import StaleDataError

LIMIT_S = 1.0
"""Age above which a value must not become a setpoint [s]. The offboard failsafe of the autopilot has the same limit."""


class StaleReads(threading.local):
    """Record of the telemetry values that were too old when the user program read them.

    Each thread has its own record, because a log thread may read old values.
    """

    def __init__(self) -> None:
        self._found: dict[str, str] = {}

    def note(self, name: str, why: str) -> None:
        """Record whether a value was too old when the program read it.

        name: such as `ekf.pos`. why: the age, as text; "" if the value was not too old.
        """
        self._found.pop(name, None)
        if why:
            self._found[name] = why

    def clear(self) -> None:
        """Delete the record of the values that were too old."""
        self._found.clear()

    def check(self) -> None:
        """Raise StaleDataError if this thread has read a value that was too old.

        Only reads since the last call count.
        """
        if self._found:
            why = next(iter(self._found.values()))
            self.clear()
            raise StaleDataError(f"no setpoint is sent, because the program has read an old value: {why}")
