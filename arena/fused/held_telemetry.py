"""Telemetry for programs that sleep on the simulation clock, joined into few datagrams. Pure.

In lockstep a program reads its socket when it wakes, so the datagrams of the steps before are sent as one. This saves most of the
system calls of router and program. The program receives the same frames in the same order.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from arena.mavlink_router.datagrams import MAX_DATAGRAM_BYTES
from arena.transport import Address
from arena.wire.mavlink_frame import Buffer

MAX_HELD_S = 0.1
"""Longest time for which a datagram is held [s, simulation time], for programs that also read their socket while they sleep."""

Place = tuple[int, Address]
"""Index of the router's socket to send from, and the address to send to."""


class HeldTelemetry:
    """Store of the telemetry for sleeping programs. It calls `send` for each joined datagram.

    programs: place of each program's socket -> name of the program as a client of the simulation clock
    asleep: names of the clients that sleep now; the owner changes this collection
    send: sends a datagram: (socket index, data, address)
    """

    def __init__(
        self,
        programs: Mapping[Place, str],
        asleep: Collection[str],
        send: Callable[[int, bytes, Address], None],
    ) -> None:
        self._programs, self._asleep, self._send = dict(programs), asleep, send
        self._places: dict[str, list[Place]] = {}
        for place, name in self._programs.items():
            self._places.setdefault(name, []).append(place)
        self._held: dict[Place, bytearray] = {}
        self._since = 0.0  # time of the oldest held datagram [s]

    def hold(self, place: Place, data: Buffer, now: float, *, join: bool = True) -> bool:
        """Hold a datagram if its receiver sleeps. Return whether it is held.

        If it is not held, the caller must send it. All that was held for this place has been sent then, so the order is kept.
        now: simulation time [s].  join: the datagram may be joined with others
        """
        name = self._programs.get(place)
        if name is None:
            return False
        held = self._held.get(place)
        if not join or name not in self._asleep or len(data) > MAX_DATAGRAM_BYTES:
            if held is not None:
                self.flush(place)
            return False
        if held is None:
            self._since = self._since if self._held else now
            self._held[place] = bytearray(data)
        elif len(held) + len(data) > MAX_DATAGRAM_BYTES:
            self.flush(place)
            self._held[place] = bytearray(data)
        else:
            held += data
        return True

    def flush(self, place: Place) -> None:
        """Send what is held for one place."""
        if (held := self._held.pop(place, None)) is not None:
            self._send(place[0], bytes(held), place[1])

    def before_wake(self, name: str) -> None:
        """Send what is held for a client of the simulation clock, which wakes now."""
        if self._held:
            for place in self._places.get(name, ()):
                self.flush(place)

    def step(self, now: float) -> None:
        """Send all datagrams if the oldest one has been held for `MAX_HELD_S`. Call this once per step.

        now: simulation time [s]
        """
        if self._held and now - self._since >= MAX_HELD_S:
            self.close()

    def close(self) -> None:
        """Send all datagrams."""
        for place in list(self._held):
            self.flush(place)
