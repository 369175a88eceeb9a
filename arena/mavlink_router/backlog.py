"""Filter for datagrams that waited in a socket while the router was stalled: frames that are too old are removed.

Asking the kernel for the age of each datagram would make the router slower. A datagram cannot be older than the time since
its socket was last empty, and `poll` reports that for free. Only if this time is longer than the shortest age limit, the
kernel's receive stamp is read.
"""

from __future__ import annotations

import socket
import time
from array import array
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, cast

from arena.kernels.socket_waits import SocketWaits
from arena.transport import Address, StampAges, enable_stamps, receive_stamped
from arena.wire.age_limits import SHORTEST_LIMIT_S, without_old_frames
from arena.wire.mavlink_frame import Buffer

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats


class Backlog:
    """Measures how long datagrams have waited in the router's sockets, and removes frames that are too old.

    links: indices in `sockets` of the links to autopilots. Frames of autopilots are never dropped, because some telemetry
    values are sent only once
    world_s: simulation time [s] (1,), if all vehicles are simulated. A datagram is then no older than the simulation
    time that has passed, so nothing is dropped while the simulation is paused or slow.
    waits: kernel that measures when each socket was last empty
    dropped: number of frames that were dropped
    """

    def __init__(
        self, sockets: Sequence[socket.socket], links: Collection[int], world_s: Floats | None
    ) -> None:
        self._sockets = sockets
        to_vehicles = [key for key in range(len(sockets)) if key not in links]
        for key in to_vehicles:
            enable_stamps(sockets[key])
        now = time.monotonic()
        self._simulated = world_s is not None
        no_world: Floats = cast("Floats", memoryview(array("d", [0.0])))
        self.waits = SocketWaits(len(sockets), to_vehicles, SHORTEST_LIMIT_S, world_s or no_world, now)
        self._ages = StampAges(time.time(), now)
        self.dropped = 0

    def tick(self, now: float) -> None:
        """Measure the offset between the wall clock and the monotonic clock.

        The operating system stamps received datagrams by the wall clock, which may jump. Call this method a few times a
        second. now: monotonic [s].
        """
        self._ages.update(time.time(), now)

    def receive(self, key: int) -> tuple[Buffer, Address]:
        """Receive from a socket a datagram that may be old, and remove the frames that are too old.

        Call this method if `waits.may_be_old` returned True.

        key: index of the socket. Returns (frames that are not too old, sender). Raises OSError.
        """
        data, sender, stamp_s = receive_stamped(self._sockets[key])
        age_s = self._age_s(key, stamp_s, time.monotonic())
        if age_s <= SHORTEST_LIMIT_S:
            return data, sender
        young, dropped = without_old_frames(data, age_s)
        self.dropped += dropped
        return young, sender

    def young(self, key: int, data: Buffer, now: float) -> Buffer:
        """Return a received datagram without the frames that may be too old.

        Call this method if `waits.is_old` returned True. The time at which the datagram arrived is not known:
        it counts as the time at which the socket was last empty.
        """
        young, dropped = without_old_frames(data, self._age_s(key, None, now))
        self.dropped += dropped
        return young

    def _age_s(self, key: int, stamp_s: float | None, now: float) -> float:
        longest_s = now - self.waits.empty_at[key]
        age_s = longest_s
        if stamp_s is not None:
            age_s = self._ages.age_s(stamp_s, time.time(), now, longest_s)
        world_age_s = self.waits.world_s[0] - self.waits.empty_world_s[key]
        return min(age_s, world_age_s) if self._simulated else age_s
