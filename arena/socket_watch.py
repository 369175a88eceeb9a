"""Search for the sockets that have received data, by one system call for many sockets."""

from __future__ import annotations

import math
import select

POLL_S = 0.5e-3
"""Wall time between two searches for sockets with data, while all programs sleep [s]."""
_NOTHING: frozenset[int] = frozenset()


class SocketWatch:
    """Set of sockets: one system call finds all sockets that have received data.

    A loop that would read many sockets, most of them empty, calls `poll` and reads only those that `has_data` names.
    """

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._found: frozenset[int] = frozenset()
        self._polled_s, self._wakes = -math.inf, 0

    def add(self, fd: int) -> None:
        """Watch a file descriptor of a socket or of an epoll object.

        An epoll object has data if one of its sockets has data.

        fd: a negative number means no socket, and is ignored
        """
        if fd >= 0:
            self._epoll.register(fd, select.EPOLLIN)

    def poll(self) -> None:
        """Find the sockets that have received data. Does not wait."""
        found = self._epoll.poll(0)
        self._found = frozenset(fd for fd, _ in found) if found else _NOTHING

    def poll_if_due(self, wall: float, wakes: int) -> None:
        """Find the sockets with data if a program was awake since the last search, or if that was at least `POLL_S` ago.

        Otherwise `has_data` returns False for every socket. A step of a fast simulation takes a fraction of `POLL_S`.

        wall: monotonic [s].  wakes: number of wake-ups of all programs so far. A program sends data only while it is awake
        """
        if wakes != self._wakes or wall >= self._polled_s + POLL_S:
            self._polled_s, self._wakes = wall, wakes
            self.poll()
        else:
            self._found = _NOTHING

    def has_data(self, fd: int) -> bool:
        """Return whether a watched socket had data, or a lost connection, at the last `poll`."""
        return fd in self._found

    def close(self) -> None:
        """Stop watching. The sockets remain open."""
        self._epoll.close()
