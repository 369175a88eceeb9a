"""Links in memory between the parts of a fused arena, which run in one process and need no sockets."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from typing import Any

from arena.mocap.client import CapturedFrame
from arena.recorder.channels import Datagram
from arena.recorder.router_copies import RouterCopies
from arena.transport import Address

Inbox = list[tuple[int, str, bytes]]
"""Datagrams for the autopilots: (index of the vehicle in the world, name of the link, data), oldest first."""


class VisionLink:
    """Connection in memory between a pose forwarder and a built-in autopilot.

    It replaces the pose forwarder's UDP socket, and has the same methods.

    vehicle: index of the vehicle in the world.  inbox: list that receives the datagrams for its autopilot.
    autopilot: address that the forwarder expects as the sender.
    """

    def __init__(self, vehicle: int, inbox: Inbox, autopilot: Address) -> None:
        self._vehicle, self._inbox, self._autopilot = vehicle, inbox, autopilot
        self.waiting: deque[bytes] = deque()

    def recvfrom(self, size: int) -> tuple[bytes, Address]:
        """Return the oldest datagram from the autopilot.

        Raises BlockingIOError if there is none.
        """
        return _take(self.waiting), self._autopilot

    def sendto(self, data: bytes, to: Address) -> int:
        """Store a datagram for the autopilot."""
        self._inbox.append((self._vehicle, "vision", data))
        return len(data)

    def fileno(self) -> int:
        """Return -1, because there is no socket."""
        return -1

    def close(self) -> None:
        """Discard the datagrams that have not been read."""
        self.waiting.clear()


class RecorderLink:
    """Input of the recorder: copies of datagrams from the router, and the wanted states that programs publish.

    The copies are passed in memory. The wanted states (references) arrive on a socket.

    listen: address of the socket.  sockets: addresses of the router's sockets, in their order.
    vehicles: as for `CopySenders`.
    copies: (vehicle, up, data) of the datagrams that the router has copied since the last call of `receive`.
    """

    def __init__(
        self, listen: Address, sockets: Sequence[Address], vehicles: Sequence[Mapping[str, Any]]
    ) -> None:
        self._copies = RouterCopies(listen, vehicles)
        self._owners = [self._copies.senders.owner(at) for at in sockets]
        self.copies: list[tuple[str, bool, bytes]] = []

    def add(self, socket: int, data: bytes) -> None:
        """Store a copy of a routed datagram for the recorder.

        socket: index of the router's socket from which it is sent.
        """
        if (owner := self._owners[socket]) is not None:
            self.copies.append((*owner, data))

    def owner(self, socket: int) -> tuple[str, bool] | None:
        """Return (vehicle, up) of the datagrams that are sent from a socket of the router; None if they are not recorded."""
        return self._owners[socket]

    def fileno(self) -> int:
        """Return the file descriptor of the socket on which user programs send their references (wanted states)."""
        return self._copies.fileno()

    def receive(self, now: float, *, references: bool = True) -> list[Datagram]:
        """Return the datagrams to record: those that the router has copied, then the references.

        now: time of reception [s].  references: read the socket, too
        """
        waiting = [(vehicle, up, data, now) for vehicle, up, data in self.copies]
        self.copies.clear()
        if references:
            waiting += [(vehicle, up, data, now) for vehicle, up, data, _ in self._copies.receive()]
        return waiting

    def close(self) -> None:
        self._copies.close()


class MemoryCapture:
    """Motion-capture client without a network: the emulator in the same process stores its frames here.

    One object serves all pose forwarders of the process.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.waiting: list[CapturedFrame] = []

    def fileno(self) -> int:
        """Return -1, because there is no socket."""
        return -1

    def poll(self, now: float) -> list[CapturedFrame]:
        """Return the new motion-capture frames, oldest first."""
        found, self.waiting = self.waiting, []
        self.counts["frames"] += len(found)
        return found

    def add_body(self, body: str) -> None:
        """Do nothing: the frames contain all bodies."""

    def definition(self, body: str) -> str:
        """Return the name of a rigid body in place of its definition, which the emulator never changes.

        The interface requires a text that changes when the rigid body is defined again.
        """
        return body

    def refresh_definitions(self) -> None:
        """Do nothing: the emulator never changes the definition (markers, pivot) of a rigid body."""

    def diagnosis(self) -> str:
        """Return "" (no problem): frames cannot be lost inside one process."""
        return ""

    def close(self) -> None:
        self.waiting.clear()


def _take(waiting: deque[bytes]) -> bytes:
    if not waiting:
        raise BlockingIOError
    return waiting.popleft()


def address(raw: Mapping[str, Any], key: str) -> Address:
    """Read an address [host, port] from the JSON configuration of a link.

    key: key of the address in `raw`
    """
    host, port = raw[key]
    return str(host), int(port)
