"""Emulated motion-capture server over UDP, for the protocol of any vendor.

One socket receives requests, another socket sends frames.
"""

from __future__ import annotations

import contextlib
import socket
from collections import Counter
from typing import Protocol

from arena.closed_ports import ClosedPorts
from arena.errors import RunError
from arena.mocap.emulator.interface import MeasuredFrame
from arena.transport import Address, is_loopback

SEARCH_S = 0.5
"""Shortest wall time between two searches for programs that receive frames without a request [s]."""
_MAX_REQUESTS = 64  # per call: a flood of requests must not delay the frames


class ServerProtocol(Protocol):
    """Interface of the protocol of a motion-capture vendor: encodes frames, replies to requests. No sockets.

    wall: monotonic wall time [s].
    counts: the server counts the frames in it; the protocol counts the requests.
    """

    counts: Counter[str]

    def begin(self, sent_s: float) -> None:
        """Store the simulation time at which the next frame is sent [s]. Called for each frame, also if nobody receives it."""

    def encode(self, frame: MeasuredFrame, sent_s: float) -> bytes:
        """Return one frame as a datagram. sent_s: simulation time of sending [s]."""

    def destinations(self, wall: float) -> list[Address]:
        """Return the addresses to which frames are sent. wall: monotonic wall time [s]."""

    def reply(self, data: bytes, sender: Address, wall: float) -> bytes | None:
        """Return the reply to a client's request, or None if the request needs no reply."""


class UdpServer:
    """Emulated motion-capture server with one UDP socket for requests and one for frames.

    A multicast frame on the loopback network costs much CPU time even if nobody receives it. So it is not sent while no program of
    this computer has the port of the group open.

    requests: address and port on which requests are received. Frames are sent from the same address, but from another
    port.
    group: multicast group to which frames are sent, if the protocol has one
    """

    def __init__(
        self, protocol: ServerProtocol, requests: Address, name: str, *, group: Address | None = None
    ) -> None:
        self._protocol = protocol
        self._requests, self._frames = _request_socket(requests, name), _frame_socket(requests[0])
        self._closed = ClosedPorts((), group=group if is_loopback(requests) else None, period_s=SEARCH_S)

    @property
    def counts(self) -> Counter[str]:
        return self._protocol.counts

    def send(self, frame: MeasuredFrame, sent_s: float, wall: float) -> int:
        self.counts["frames"] += 1
        self._protocol.begin(sent_s)
        self._closed.refresh(wall)
        receivers = [to for to in self._protocol.destinations(wall) if to not in self._closed.now]
        data, failed = self._protocol.encode(frame, sent_s) if receivers else b"", 0
        for address in receivers:
            try:
                self._frames.sendto(data, address)
            except OSError:  # a full queue, or a network that is away: the next frame will be newer
                failed += 1
        return failed

    def answer(self, wall: float) -> None:
        for k in range(_MAX_REQUESTS):
            try:
                data, sender = self._requests.recvfrom(2048)
            except OSError:
                return
            if k == 0 and self._closed.now:  # a client has probably opened its port before it sends a request
                self.search_receivers()
            reply = self._protocol.reply(data, sender, wall)
            if reply is not None:
                with contextlib.suppress(OSError):
                    self._requests.sendto(reply, sender)

    def search_receivers(self) -> None:
        self._closed.search()

    def fileno(self) -> int:
        return self._requests.fileno()

    def close(self) -> None:
        self._requests.close()
        self._frames.close()


def _request_socket(address: Address, protocol_name: str) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setblocking(False)
    try:
        s.bind(address)
    except OSError as error:
        s.close()
        raise RunError(
            f"motion capture emulator: cannot serve {protocol_name} on UDP {address[0]}:{address[1]}: {error.strerror}. "
            "Does another program use this port?"
        ) from error
    return s


def _frame_socket(address: str) -> socket.socket:
    """Open the UDP socket from which frames are sent, on any free port of `address`.

    On the clients' port, this socket would receive the frames that are meant for the clients.
    """
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setblocking(False)
    s.bind((address, 0))
    s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address))
    s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
    return s
