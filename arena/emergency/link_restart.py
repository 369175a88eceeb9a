"""Decision how long land-all waits for the restart of a link process that has ended.

The files in the run folder show whether the supervisor restarts the process.
"""

from __future__ import annotations

from pathlib import Path

from arena.emergency.link_process import is_running
from arena.emergency.run_record import ProcessIdentity, has_given_up, recorded_process

RESTART_S = 3.0
"""Longest wait for a link process that has ended and that the supervisor may start again [s]."""
_READ_EVENTS_S = 0.5


class LinkRestart:
    """Decides how long land-all waits for the restart of one link process, and detects the restart.

    Call `is_expected` while no link process serves the vehicle, `on_link` when one does, and `on_replaced` when its
    port or device was opened in its place.
    name: name of the process, such as `link.uav1`
    run: run folder; None if unknown
    """

    def __init__(self, name: str, run: Path | None) -> None:
        self._name, self._run = name, run
        self._ended_at: float | None = None
        self._given_up, self._next_read = False, 0.0
        self._known: ProcessIdentity | None = None

    def on_link(self) -> None:
        """Record that the link process runs now.

        When the process ends later, land-all waits again for its restart.
        """
        self._ended_at = None

    def is_expected(self, now: float) -> bool:
        """Return whether land-all waits for a restart of the link process.

        The wait ends RESTART_S after the end of the process.

        There is no wait if the supervisor does not run, or has recorded that it gives up the restart.
        """
        if self._ended_at is None:
            self._ended_at = now
            self._given_up, self._next_read = False, now
        if self._run is None or now - self._ended_at >= RESTART_S:
            return False
        if self.has_restarted():
            return True
        if not is_running(recorded_process("supervisor", self._run)):
            return False
        if now >= self._next_read:
            self._next_read = now + _READ_EVENTS_S
            self._given_up = has_given_up(self._name, self._run)
        return not self._given_up

    def on_replaced(self) -> None:
        """Record that land-all has opened the port or device of the link process.

        `has_restarted` then returns True as soon as the supervisor has started a new link process.
        """
        self._known = self._running()

    def has_restarted(self) -> bool:
        """Return whether the supervisor has started a new link process."""
        process = self._running()
        return process is not None and process != self._known

    def _running(self) -> ProcessIdentity | None:
        process = recorded_process(self._name, self._run) if self._run is not None else None
        return process if is_running(process) else None
