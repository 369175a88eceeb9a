"""A thread that carries out writes, so that a frozen terminal or a slow disk never blocks the main loop of the supervisor."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable

Job = Callable[[], None]


class BackgroundWriter:
    """Bounded queue of writes, and the thread that carries them out in order. No method blocks, except `flush`.

    Each write is a function without arguments that handles its own errors.
    limit: number of waiting writes. One more removes the oldest and counts it as lost.
    """

    def __init__(self, name: str, limit: int) -> None:
        self._name, self._limit = name, limit
        self._jobs: deque[tuple[str, Job]] = deque()
        self._changed = threading.Condition()
        self._began: float | None = None
        self._thread: threading.Thread | None = None
        self._lost = 0

    def submit(self, job: Job, *, replaces: str = "") -> None:
        """Add a write to the queue. replaces: key of the write; a waiting write with the same key is removed, because
        only the newest one matters.
        """
        with self._changed:
            if replaces:
                self._jobs = deque(entry for entry in self._jobs if entry[0] != replaces)
            elif len(self._jobs) >= self._limit:
                self._jobs.popleft()
                self._lost += 1
            self._jobs.append((replaces, job))
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
            self._changed.notify_all()

    @property
    def busy(self) -> bool:
        """True while a write waits or is not complete."""
        return self._began is not None or bool(self._jobs)

    def blocked_s(self, now: float) -> float:
        """Return for how long the current write has not been complete [s]; 0 if there is none. now: monotonic [s]."""
        began = self._began
        return now - began if began is not None else 0.0

    def take_lost(self) -> int:
        """Return the number of lost writes since the last call."""
        with self._changed:
            found, self._lost = self._lost, 0
            return found

    def flush(self, timeout_s: float) -> bool:
        """Wait until all writes are complete, at most `timeout_s` [s]. Return False if some are not complete then."""
        with self._changed:
            return self._changed.wait_for(lambda: not self.busy, timeout_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._began = None
                self._changed.notify_all()
                self._changed.wait_for(lambda: bool(self._jobs))
                _, job = self._jobs.popleft()
                self._began = time.monotonic()
            job()


def write_all(fd: int, data: bytes) -> None:
    """Write all bytes to a file descriptor. Raises OSError."""
    while data:
        data = data[os.write(fd, data) :]
