"""Thread that asks the supervisor for the status of a run once a second, so that a paused supervisor delays no viewer."""

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
    """Newest reply of a supervisor to the request `view`, and whether the supervisor replies.

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
        """Return the number of replies so far, and the last one; {} before the first."""
        return self._number, self._status

    def answers(self, now: float) -> bool:
        """Return whether the supervisor has replied within the last seconds. now: monotonic [s]."""
        return now - self._at <= PERIOD_S + _TIMEOUT_S

    def close(self) -> None:
        """End the thread. Does not wait for a reply."""
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
