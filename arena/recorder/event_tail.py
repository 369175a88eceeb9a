"""Reads the lines that other processes append to events.jsonl.

A thread reads the file, because the disk may not respond.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path

from arena.background_writer import BackgroundWriter

MAX_BYTES = 1 << 20
"""Largest number of bytes that are read at a time."""


class EventTail:
    """Reader of the complete lines that another process appends to a file.

    path: the file; it may be created later.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread = BackgroundWriter("events", 1)
        self._lines: deque[bytes] = deque()
        self._offset = 0

    @property
    def busy(self) -> bool:
        """True while the background thread reads the file."""
        return self._thread.busy

    def poll(self) -> None:
        """Start to read the new lines in a background thread. Do nothing while a read is in progress."""
        if not self._thread.busy:
            self._thread.submit(self._read)

    def take(self) -> list[bytes]:
        """Return the lines that have been read since the last call, without line ends."""
        found = []
        while self._lines:
            found.append(self._lines.popleft())
        return found

    def close(self, timeout_s: float = 1.0) -> list[bytes]:
        """Read the file for the last time and return its new lines.

        timeout_s: wait at most this long for the disk [s].
        """
        self._thread.flush(timeout_s)
        self.poll()
        self._thread.flush(timeout_s)
        return self.take()

    def _read(self) -> None:
        try:
            with self._path.open("rb") as file:
                file.seek(self._offset)
                data = file.read(MAX_BYTES)
        except OSError:
            return
        whole = data[: data.rfind(b"\n") + 1]
        self._offset += len(whole)
        self._lines.extend(line for line in whole.split(b"\n") if line)
