"""Telemetry for programs that sleep on the simulation clock, joined into few datagrams. Pure.

In lockstep a program reads its socket when it wakes, so the datagrams of the steps before are sent as one. This saves most of the
system calls of router and program. The program receives the same frames in the same order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    Address = tuple[str, int]
    Place = tuple[int, Address]
    Buffer = bytes | bytearray | memoryview

MAX_HELD_S = 0.1
"""Longest time for which a datagram is held [s, simulation time], for programs that also read their socket while they sleep."""
_MAX_HELD_S = MAX_HELD_S  # the same number with a C type, see the .pxd file


class ProgramPlace:
    """Address of one program, and the telemetry that waits for it.

    socket, address: index of the router's socket to send from, and the address to send to
    program: name of the program as a client of the simulation clock
    held: joined datagrams; None if none is held
    """

    def __init__(self, socket: int, address: Address, program: str) -> None:
        self.socket, self.address, self.program = socket, address, program
        self.held: bytearray | None = None


class HeldTelemetry:
    """Store of the telemetry for sleeping programs. It calls `send` for each joined datagram.

    programs: (socket index, address) of each program's socket -> name of the program as a client of the simulation clock
    asleep: names of the clients that sleep now; the owner changes this collection
    send: sends a datagram: (socket index, data, address)
    max_bytes: size of the largest joined datagram
    """

    def __init__(
        self,
        programs: Mapping[Place, str],
        asleep: Collection[str],
        send: Callable[[int, Buffer, Address], None],
        max_bytes: int,
    ) -> None:
        self._asleep, self.send, self._max_bytes = asleep, send, max_bytes
        self._places: dict[Place, ProgramPlace] = {}
        self._of_program: dict[str, list[ProgramPlace]] = {}
        for (socket, to), name in programs.items():
            place = self._places[socket, to] = ProgramPlace(socket, to, name)
            self._of_program.setdefault(name, []).append(place)
        self._waiting: list[ProgramPlace] = []  # with held telemetry, sorted by their oldest datagram
        self._since = 0.0  # time of the oldest held datagram [s]

    def place(self, socket: int, to: Address) -> ProgramPlace | None:
        """Return the place of a program's socket; None for another receiver."""
        return self._places.get((socket, to))

    def hold(self, place: ProgramPlace, data: Buffer, now: float, join: bool) -> bool:
        """Hold a datagram if its receiver sleeps. Return whether it is held.

        If False, the caller must send the datagram. `hold` has then sent the older datagrams of this place, so the order is kept.
        now: simulation time [s].  join: the datagram may be joined with others
        """
        held, size = place.held, len(data)
        if not join or size > self._max_bytes or place.program not in self._asleep:
            if held is not None:
                self._flush(place)
            return False
        if held is not None and len(held) + size > self._max_bytes:
            self._flush(place)
            held = None
        if held is None:
            if not self._waiting:
                self._since = now
            place.held = bytearray(data)
            self._waiting.append(place)
        else:
            held += data
        return True

    def before_wake(self, program: str) -> None:
        """Send the telemetry that is held for a client of the simulation clock. Call this directly before the client wakes."""
        if self._waiting:
            for place in self._of_program.get(program, ()):
                if place.held is not None:
                    self._flush(place)

    def step(self, now: float) -> None:
        """Send all datagrams if the oldest one has been held for `MAX_HELD_S`. Call this once per step.

        now: simulation time [s]
        """
        if self._waiting and now - self._since >= _MAX_HELD_S:
            self.close()

    def close(self) -> None:
        """Send all datagrams."""
        while self._waiting:
            self._flush(self._waiting[0])

    def _flush(self, place: ProgramPlace) -> None:
        """Send the telemetry that is held for one program."""
        held, place.held = place.held, None
        self._waiting.remove(place)
        if held is not None:
            self.send(place.socket, bytes(held), place.address)
