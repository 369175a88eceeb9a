"""Computes how long datagrams can have waited in a socket, from the time at which it was last empty. Pure.

A poll reports the sockets that contain data; the others are empty. A datagram cannot have waited longer than the time since its
socket was last empty.
"""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from collections.abc import Collection

    from arena.kernels.arrays import Floats


class SocketWaits:
    """Record of the time at which each of N sockets was last empty.

    world_s: simulation time [s] (1,); its present value is read at each poll
    limit_s: datagrams that may have waited longer are old [s]
    limited: 1 for sockets whose datagrams can be old (N,)
    empty_at, empty_world_s: monotonic time and simulation time at which the socket was last empty [s] (N,)
    """

    def __init__(
        self, sockets: int, limited: Collection[int], limit_s: float, world_s: Floats, now: float
    ) -> None:
        self.world_s, self.limit_s = world_s, limit_s
        times: Floats = cast("Floats", memoryview(array("d", [now]) * (2 * sockets)))
        self.empty_at, self.empty_world_s = times[:sockets], times[sockets:]
        # reported: number of the last poll that reported the socket
        numbers = memoryview(array("l", [-1]) * (2 * sockets))
        self.limited, self._reported = numbers[:sockets], numbers[sockets:]
        for i in range(sockets):
            self.limited[i], self.empty_world_s[i] = i in limited, world_s[0]
        self._poll = 0
        self._now = self._last = now
        self._world_now = self._last_world = world_s[0]

    def before_poll(self, now: float) -> int:
        """Store the time at which the next poll of the sockets begins. Return the number of this poll.

        now: monotonic [s].
        """
        self._poll += 1
        self._last, self._last_world = self._now, self._world_now
        self._now, self._world_now = now, self.world_s[0]
        return self._poll

    def may_be_old(self, i: int, now: float) -> bool:
        """Store that the poll found datagrams in socket i. Return whether they may have waited longer than `limit_s`.

        Call this once for each socket that the poll has reported. now: monotonic [s].
        """
        if self._reported[i] != self._poll - 1:  # the last poll did not report the socket, so it was empty
            self.empty_at[i], self.empty_world_s[i] = self._last, self._last_world
        self._reported[i] = self._poll
        return self.is_old(i, now)

    def is_old(self, i: int, now: float) -> bool:
        """Return whether datagrams that are in socket i at `now` may have waited longer than `limit_s`.

        Call `may_be_old` first. now: monotonic [s].
        """
        return now - self.empty_at[i] > self.limit_s and self.limited[i] != 0
