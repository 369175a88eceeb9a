"""Thread that requests the status of a run from the supervisor once a second.

Viewers are not delayed if the supervisor is paused.
"""

from __future__ import annotations

import contextlib
import threading
import time
from pathlib import Path
from typing import Any

from arena.errors import RunError
from arena.supervisor import Control

PERIOD_S = 1.0
_TIMEOUT_S = 3.0


class RunStatus:
    """Newest status that the supervisor of a run has sent, requested in a thread once a second.

    This request, unlike `ps`, does not mean that an operator is present, so the data-link failsafe of real vehicles still works.

    control: path of the control socket.
    """

    def __init__(self, control: Path) -> None:
        self._control = control
        self._status: dict[str, Any] = {}
        self._number = 0
        self._at = float("-inf")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="status of the run", daemon=True)
        self._thread.start()

    @property
    def newest(self) -> tuple[int, dict[str, Any]]:
        """Return (number of replies so far, last reply). The reply is {} before the first one."""
        return self._number, self._status

    def answers(self, now: float) -> bool:
        """Return whether the supervisor has replied recently. now: monotonic [s]."""
        return now - self._at <= PERIOD_S + _TIMEOUT_S

    def close(self) -> None:
        """End the thread, without waiting for a reply."""
        self._stop.set()

    def _run(self) -> None:
        connection: Control | None = None
        while not self._stop.is_set():
            try:
                connection = connection or Control(self._control, _TIMEOUT_S)
                self._status = connection.ask(do="view")
                self._number += 1
                self._at = time.monotonic()
            except (RunError, OSError, ValueError):
                if connection is not None:
                    connection.close()
                connection = None
            self._stop.wait(PERIOD_S)
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.close()
