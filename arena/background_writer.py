"""Writes to files and terminals in a background thread, so that a slow disk does not block the caller.

A frozen terminal, or a disk that does not respond, must not end a flight or a landing.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TextIO, TypeVar

Job = Callable[[], None]
T = TypeVar("T")


class BackgroundWriter:
    """Queue of limited length for writes to a file or terminal, and the thread that executes them in order.

    No method blocks, except `flush`.

    Each write is a function without arguments that handles its own errors.
    limit: largest number of waiting writes. If a write is added to a full queue, the oldest write is removed and lost.
    """

    def __init__(self, name: str, limit: int) -> None:
        self._name, self._limit = name, limit
        self._jobs: deque[tuple[str, Job]] = deque()
        self._changed = threading.Condition()
        self._began: float | None = None
        self._thread: threading.Thread | None = None
        self._lost = 0

    def submit(self, job: Job, *, replaces: str = "") -> None:
        """Add a write to the queue, to be executed by the writing thread.

        replaces: key of the write; a waiting write with the same key is removed, because only the newest one matters.
        """
        with self._changed:
            if replaces:
                self._jobs = deque(entry for entry in self._jobs if entry[0] != replaces)
            elif len(self._jobs) >= self._limit:
                self._jobs.popleft()
                self._lost += 1
            self._jobs.append((replaces, job))
            if self._thread is None or not self._thread.is_alive():  # it does not exist in a forked process
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
            self._changed.notify_all()

    @property
    def busy(self) -> bool:
        """True while a write waits in the queue or is in progress."""
        return self._began is not None or bool(self._jobs)

    def blocked_s(self, now: float) -> float:
        """Return how long the current write has already taken [s]; 0 if no write is in progress.

        now: monotonic [s].
        """
        began = self._began
        return now - began if began is not None else 0.0

    def take_lost(self) -> int:
        """Return how many writes were dropped since the last call because the queue was full."""
        with self._changed:
            found, self._lost = self._lost, 0
            return found

    def flush(self, timeout_s: float) -> bool:
        """Wait until all writes are complete, at most `timeout_s` [s].

        Return whether all are complete.
        """
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


def within(
    timeout_s: float, job: Callable[[], T], discard: Callable[[T], None] = lambda result: None
) -> T | None:
    """Run a function in a new thread. Wait for its result at most `timeout_s` [s]; return None after that time.

    job: function that handles its own errors.
    discard: called with a result that comes too late, for example to close a file.
    """
    found: list[T] = []
    lock, ended, late = threading.Lock(), threading.Event(), threading.Event()

    def run() -> None:
        result = job()
        with lock:
            if not late.is_set():
                found.append(result)
                ended.set()
                return
        discard(result)

    threading.Thread(target=run, name="within", daemon=True).start()
    ended.wait(timeout_s)
    with lock:
        late.set()
    return found[0] if found else None


def write_to(stream: TextIO, text: str) -> None:
    """Write a text to a stream.

    Raises OSError if the write fails, ValueError if the stream is closed.

    A stream with a file descriptor is written without its buffer, because Python aborts at exit if a thread is blocked in a
    buffer.
    """
    try:
        fd = stream.fileno()
    except (OSError, ValueError):  # replaced by a test
        stream.write(text)
        stream.flush()
        return
    write_all(fd, text.encode(errors="replace"))


def write_all(fd: int, data: bytes) -> None:
    """Write all bytes to a file descriptor. Raises OSError."""
    while data:
        data = data[os.write(fd, data) :]
