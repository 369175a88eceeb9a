"""The program's heartbeat to the copilot: sent in the program's own calls alone, so that one that hangs falls silent, whatever
a thread of its SDK goes on to send.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock, WallClock
from arena.transport import open_udp
from arena.wire.mavlink_codec import Codec

_PERIOD_S = 0.1


class Heart:
    """address: where the copilot listens, None where there is none: beating is free then. clock: what the rate is counted by.

    `arena.UAV` has one of its own and beats it. A program that flies with an SDK calls `beat` in its main loop:

        heart = Heart.from_args()
        while flying:
            heart.beat()
    """

    def __init__(self, address: tuple[str, int] | None, system_id: int, clock: Clock | None = None) -> None:
        self._address, self._clock = address, WallClock() if clock is None else clock
        self._codec = Codec(system_id, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
        self._socket = open_udp()
        self._due = -1e18

    @classmethod
    def from_args(cls, argv: Sequence[str] | None = None) -> Heart:
        """For the vehicle that the supervisor passes (`--uav FILE`); other arguments are the program's own."""
        from arena.uav.arguments import read_arguments

        found = read_arguments(argv)
        return cls(found.get("heart"), found["system_id"], found["clock"])

    def beat(self) -> None:
        """I am alive, and so is my loop. Ten times a second at most: call it as often as you like."""
        if self._address is None:
            return
        now = self._clock.now()
        if now < self._due:
            return
        self._due = now + _PERIOD_S
        with contextlib.suppress(OSError):  # no copilot there now: it watches nobody
            self._socket.sendto(self._codec.onboard_heartbeat(), self._address)

    def close(self) -> None:
        self._socket.close()
