"""Detects datagrams that waited in a socket while the router was stalled, and removes the frames that became too old.

Asking the kernel for the age of each datagram would make the router slower. A datagram cannot be older than the time since
its socket was last empty, and `poll` reports that for free. Only if this time is longer than the shortest age limit, the
kernel's receive stamp is read.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Collection, Sequence

from arena.clock import SimTime
from arena.transport import Address, StampAges, enable_stamps, receive_stamped
from arena.wire.age_limits import SHORTEST_LIMIT_S, without_old_frames
from arena.wire.mavlink_frame import Buffer

_Moment = tuple[float, float]
"""Monotonic time and simulation time, both [s]."""


class Backlog:
    """Measures how long datagrams have waited in the router's sockets, and drops the frames that are too old.

    links: indices in `sockets` of the links to autopilots; what these send is never dropped, because telemetry
    has values that are sent only once
    world_time: simulation time, if all vehicles are simulated. A datagram is then no older than the simulation
    time that has passed, so nothing is dropped while the simulation is paused or slow.
    dropped: number of frames that were dropped
    """

    def __init__(
        self, sockets: Sequence[socket.socket], links: Collection[int], world_time: SimTime | None
    ) -> None:
        self._sockets = {s.fileno(): s for s in sockets}
        self._to_vehicles = {s.fileno() for key, s in enumerate(sockets) if key not in links}
        for fd in self._to_vehicles:
            enable_stamps(self._sockets[fd])
        self._world_time = world_time
        now = time.monotonic()
        self._ages = StampAges(time.time(), now)
        self._turn = 0
        self._this_poll = self._last_poll = self._moment(now)
        self._readable: dict[int, tuple[int, _Moment]] = dict.fromkeys(self._sockets, (-1, self._this_poll))
        self.dropped = 0

    def before_poll(self, now: float) -> None:
        """Record that the next poll of the sockets begins. `may_be_old` needs this time. now: monotonic [s]."""
        self._turn += 1
        self._last_poll, self._this_poll = self._this_poll, self._moment(now)

    def tick(self, now: float) -> None:
        """Compare the wall clock with the monotonic clock, because the kernel stamps datagrams by the wall clock.

        Call this method a few times a second. now: monotonic [s].
        """
        self._ages.update(time.time(), now)

    def may_be_old(self, fd: int, now: float) -> bool:
        """Return whether the next datagram of a socket may be too old. Call this method once for each socket that `poll` reports."""
        turn, empty = self._readable[fd]
        if turn != self._turn - 1:  # the last poll did not report the socket, so it was empty
            empty = self._last_poll
        self._readable[fd] = self._turn, empty
        return now - empty[0] > SHORTEST_LIMIT_S and fd in self._to_vehicles

    def receive(self, fd: int) -> tuple[Buffer, Address]:
        """Receive a datagram from a socket for which `may_be_old` returned True. Frames that are too old are dropped.

        Returns (the other frames, sender). Raises OSError.
        """
        data, sender, stamp_s = receive_stamped(self._sockets[fd])
        age_s = self._age_s(fd, stamp_s, time.monotonic())
        if age_s <= SHORTEST_LIMIT_S:
            return data, sender
        young, dropped = without_old_frames(data, age_s)
        self.dropped += dropped
        return young, sender

    def _age_s(self, fd: int, stamp_s: float | None, now: float) -> float:
        empty_at, world_s = self._readable[fd][1]
        longest_s = now - empty_at
        age_s = longest_s
        if stamp_s is not None:
            age_s = self._ages.age_s(stamp_s, time.time(), now, longest_s)
        return age_s if self._world_time is None else min(age_s, self._world_time.now() - world_s)

    def _moment(self, now: float) -> _Moment:
        return now, 0.0 if self._world_time is None else self._world_time.now()
