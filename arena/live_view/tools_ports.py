"""Receiver of the telemetry of all vehicles, from the router's UDP ports for tools.

The router sends the telemetry of a vehicle to each program that has sent a frame to its tools port within the last 10 s.
This receiver sends PING, addressed to the router itself. The router forwards no such frame, so no vehicle receives anything:
the receiver cannot count as ground station, program or pilot, and it cannot change the rate of a message.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence

from arena.transport import Address, open_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import VIEWER
from arena.wire.router_ping import PING_PERIOD_S, ping_router

_DATAGRAM_BYTES = 1 << 16
_MAX_DATAGRAMS = 500  # per vehicle and call: a flood must not delay the viewer


class ToolsPorts:
    """Receiver of the telemetry of all vehicles, with one socket per vehicle. It never blocks.

    addresses: tools port of each vehicle; None for a vehicle without telemetry.
    on_datagram: called with the index of the vehicle, a datagram and the time [s].
    """

    def __init__(
        self, addresses: Sequence[Address | None], on_datagram: Callable[[int, bytes, float], None]
    ) -> None:
        self._codec = Codec(VIEWER.system, VIEWER.component)
        self._sockets: list[tuple[int, socket.socket]] = []
        self._on_datagram = on_datagram
        self._next_ping = float("-inf")
        for row, address in enumerate(addresses):
            if address is not None:
                sock = open_udp((address[0], 0))
                sock.connect(address)  # so that the socket receives from this port only
                self._sockets.append((row, sock))

    def poll(self, now: float) -> None:
        """Pass all received datagrams to the callback, and send a PING to the router periodically.

        The router sends telemetry only to programs that send something. now: monotonic [s].
        """
        if now >= self._next_ping:
            self._next_ping = now + PING_PERIOD_S
            ping = self._codec.pack(ping_router())
            for _, sock in self._sockets:
                _send(sock, ping)
        for row, sock in self._sockets:
            for _ in range(_MAX_DATAGRAMS):
                try:
                    data = sock.recv(_DATAGRAM_BYTES)
                except OSError:  # nothing received, or no router that listens
                    break
                self._on_datagram(row, data, now)

    def close(self) -> None:
        """Close all sockets. The router stops sending telemetry to them 10 s later."""
        for _, sock in self._sockets:
            sock.close()


def _send(sock: socket.socket, data: bytes) -> None:
    try:
        sock.send(data)
    except OSError:  # no router listens
        return
