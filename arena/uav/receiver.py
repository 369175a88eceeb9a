"""Background thread that receives the data of a program's vehicle connections, for programs on the wall clock."""

from __future__ import annotations

import threading
from collections.abc import Callable

from arena.uav.shared_capture import SharedCapture

_PERIOD_S = 0.02  # 50 wake-ups a second instead of one per datagram


class Receiver:
    """Thread that calls the `chores` of its connections every 20 ms of wall time.

    These functions receive data, and send heartbeats that are due. The thread runs while it has a connection.

    capture: motion capture clients, which the connections share, too.
    """

    def __init__(self) -> None:
        self.capture = SharedCapture()
        self._chores: tuple[Callable[[], None], ...] = ()
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def add(self, chores: Callable[[], None]) -> None:
        """Call the function `chores` every 20 ms from now on. The function must not raise."""
        with self._lock:
            self._chores = (*self._chores, chores)
            if self._thread is None:
                self._ending = threading.Event()
                run = threading.Thread(
                    target=self._run, args=(self._ending,), name="arena.uav connection", daemon=True
                )
                self._thread = run
                run.start()

    def remove(self, chores: Callable[[], None]) -> None:
        """Stop calling the function `chores`. If no other function is left, wait until the thread has ended."""
        with self._lock:
            self._chores = tuple(each for each in self._chores if each != chores)
            thread = None if self._chores else self._thread
            if thread is not None:
                self._ending.set()
                self._thread = None
        if thread is not None and threading.current_thread() is not thread:
            thread.join(1.0)

    def _run(self, ending: threading.Event) -> None:
        while not ending.wait(_PERIOD_S):
            for chores in self._chores:
                chores()
