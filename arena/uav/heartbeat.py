"""Heartbeat that a user program sends to the copilot.

The heartbeat is sent only inside calls of the program. So a program that hangs stops sending, even if threads of its SDK
continue.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from arena.clock import Clock, WallClock
from arena.transport import open_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import PROGRAM_COMPONENT

_PERIOD_S = 0.1


class Heartbeat:
    """Sender of one user program's heartbeats to the copilot.

    address: address of the copilot; None without a copilot, and then nothing is sent.
    system_id: MAV_SYS_ID of the vehicle.
    clock: clock that limits the rate; the wall clock by default.

    `arena.UAV` sends heartbeats by itself. A program that flies with an SDK calls `beat` in its main loop:

        heartbeat = Heartbeat.from_args()
        while flying:
            heartbeat.beat()
    """

    def __init__(self, address: tuple[str, int] | None, system_id: int, clock: Clock | None = None) -> None:
        self._address, self._clock = address, WallClock() if clock is None else clock
        self._codec = Codec(system_id, PROGRAM_COMPONENT)
        self._socket = open_udp(receive_buffer_bytes=None)
        self._due = -1e18

    @classmethod
    def from_args(cls, argv: Sequence[str] | None = None) -> Heartbeat:
        """Return the heartbeat sender for the vehicle of the argument `--uav FILE`. Other arguments are ignored."""
        from arena.uav.arguments import read_arguments

        found = read_arguments(argv)
        return cls(found.get("heartbeat"), found["system_id"], found["clock"])

    def beat(self) -> None:
        """Send a heartbeat, at most every 0.1 s. The program may call this method at any rate."""
        if self._address is None:
            return
        now = self._clock.now()
        if now < self._due:
            return
        self._due = now + _PERIOD_S
        with contextlib.suppress(OSError):  # no copilot is there now
            self._socket.sendto(self._codec.onboard_heartbeat(), self._address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
