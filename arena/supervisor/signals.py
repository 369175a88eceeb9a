"""A queue of received signals, with a file descriptor that wakes the main loop."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator
from types import FrameType
from typing import Any

_HANDLED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP, signal.SIGCHLD)


class SignalQueue:
    """Context manager that queues the signals of this process, such as SIGINT and SIGCHLD, for the main loop.

    It installs handlers on entry and restores the old handlers on exit.

    fd: file descriptor that becomes readable when a signal is received.
    """

    def __init__(self) -> None:
        self._queue: list[int] = []
        self._before: dict[int, Any] = {}
        self.fd, self._wake = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)

    def __enter__(self) -> SignalQueue:
        self._old_fd = signal.set_wakeup_fd(self._wake, warn_on_full_buffer=False)
        self._before = {number: signal.signal(number, self._append) for number in _HANDLED}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._old_fd)
        os.close(self.fd)
        os.close(self._wake)

    def drain(self) -> None:
        """Read all bytes from the file descriptor `fd`. Then the main loop wakes only for new signals."""
        with contextlib.suppress(BlockingIOError):
            while os.read(self.fd, 4096):
                pass

    def take(self) -> Iterator[int]:
        """Yield the numbers of the signals since the last call, in order, and remove them from the queue."""
        while self._queue:
            yield self._queue.pop(0)

    def _append(self, number: int, frame: FrameType | None) -> None:
        self._queue.append(number)
