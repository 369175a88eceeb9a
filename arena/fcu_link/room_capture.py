"""Motion-capture client that receives all captured bodies, for the axes check of `arena preflight`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.errors import ArenaError
from arena.mocap.client import CapturedFrame, MocapClient, open_client


class RoomCapture:
    """Motion-capture client that is open only while an axes check (`arena preflight`) runs.

    settings: settings of the client (key `capture` of the process's JSON configuration); None without motion capture
    error: why the client cannot be opened; "" if it can
    """

    def __init__(self, settings: Mapping[str, Any] | None) -> None:
        self._settings = settings
        self._client: MocapClient | None = None
        self.error = ""

    def set_open(self, wanted: bool) -> None:
        """Open or close the motion-capture client.

        After an error, the client is opened again when the next axes check starts.
        """
        if not wanted:
            self.error = ""
            self.close()
        elif self._client is None and self._settings is not None and not self.error:
            try:
                self._client = open_client(dict(self._settings))
            except ArenaError as error:
                self.error = str(error)

    def fileno(self) -> int | None:
        """Return the client's file descriptor, for `poll`; None while the client is closed."""
        return None if self._client is None else self._client.fileno()

    def poll(self, now: float) -> list[CapturedFrame]:
        """Return the captured frames that have arrived, oldest first. Never blocks."""
        return [] if self._client is None else self._client.poll(now)

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
