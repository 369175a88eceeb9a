"""Replacements of sockets between parts of the arena that run in one process. Data are stored until the receiver reads them."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from typing import Any

from arena.mocap.client import CapturedFrame
from arena.transport import Address, listen_udp

Inbox = list[tuple[int, str, bytes]]
"""Datagrams for the autopilots: (index of the vehicle in the world, name of the link, data), oldest first."""


class VisionLink:
    """Vision link of one vehicle: the connection on which its pose forwarder sends poses to the built-in autopilot.

    It replaces the pose forwarder's UDP socket, and has the same methods.

    vehicle: index of the vehicle in the world.  inbox: list that receives the datagrams for its autopilot.
    autopilot: address that the forwarder expects as the sender.
    """

    def __init__(self, vehicle: int, inbox: Inbox, autopilot: Address) -> None:
        self._vehicle, self._inbox, self._autopilot = vehicle, inbox, autopilot
        self.waiting: deque[bytes] = deque()

    def recvfrom(self, size: int) -> tuple[bytes, Address]:
        """Return the oldest datagram from the autopilot. Raises BlockingIOError if there is none."""
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


class LoggerLink:
    """Source of the datagrams for one logger: those of the router come from memory, those of the user program from a socket.

    at: address of the socket.
    """

    def __init__(self, at: Address) -> None:
        self.waiting: deque[bytes] = deque()
        self._socket = listen_udp(at, "the logger")

    def recv(self, size: int) -> bytes:
        """Return the next datagram: first those of the router, then those of the user program, each oldest first.

        Raises BlockingIOError if there is none.
        """
        return self.waiting.popleft() if self.waiting else self._socket.recv(size)

    def close(self) -> None:
        self._socket.close()


class MemoryCapture:
    """Motion-capture client whose frames come from the emulator in the same process."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.waiting: list[CapturedFrame] = []

    def fileno(self) -> int:
        """Return -1, because there is no socket."""
        return -1

    def poll(self, now: float) -> list[CapturedFrame]:
        """Return the frames that have arrived, oldest first."""
        found, self.waiting = self.waiting, []
        self.counts["frames"] += len(found)
        return found

    def definition(self, body: str) -> str:
        """Return the body's name.

        The interface requires a text that changes when the rigid body is defined again. In the emulator this never happens.
        """
        return body

    def refresh_definitions(self) -> None:
        """Do nothing, because the emulator never changes the definition (markers, pivot) of a rigid body."""

    def diagnosis(self) -> str:
        """Return "" (no problem), because frames cannot be lost inside one process."""
        return ""

    def close(self) -> None:
        self.waiting.clear()


def _take(waiting: deque[bytes]) -> bytes:
    if not waiting:
        raise BlockingIOError
    return waiting.popleft()


def address(raw: Mapping[str, Any], key: str) -> Address:
    """Return the address [host, port] under `key` of a link's configuration."""
    host, port = raw[key]
    return str(host), int(port)
