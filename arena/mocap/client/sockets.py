"""UDP sockets of a motion-capture client.

They use one network interface and accept only datagrams of one server.
"""

from __future__ import annotations

import contextlib
import math
import select
import socket
import sys
import time
from collections import Counter

from arena.clock_reading import read_together
from arena.datagrams import read_datagrams
from arena.mocap.client.reception import Reception
from arena.transport import enable_stamps, receive_stamped

_IP_MULTICAST_ALL = 49  # linux/in.h; the socket module does not name it
_RETRY_S = 1.0  # between tries to open sockets while there is no network
_MAX_DATAGRAMS = 256  # per socket and read: more than a default buffer holds, so nothing older stays behind
_STAMPED_BUFFER_BYTES = 4 << 20  # holds the datagrams of a client that reads late


def local_address_for(server: str, port: int) -> str:
    """Return the address of this computer's network interface that routes to the server.

    Sends nothing. Raises OSError without a route.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.connect((server, port))
        return str(s.getsockname()[0])


def udp_socket(address: str, port: int) -> socket.socket:
    """Open a non-blocking UDP socket. Raises OSError.

    Several processes can bind the same fixed port. port: 0 for any free port.
    """
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        s.setblocking(False)
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1 if port else 0)
        s.bind((address, port))
    except OSError:
        s.close()
        raise
    return s


def multicast_socket(group: str, port: int, local: str) -> socket.socket:
    """Open a socket that receives the datagrams of one multicast group on one interface.

    Raises OSError. The socket is bound to the group's address, so that it does not receive other groups on
    the same port. By default Linux delivers every datagram of the group that reaches the computer, even if
    another program joined the group on another interface; IP_MULTICAST_ALL = 0 switches this off.
    """
    s = udp_socket(group, port)
    try:
        if sys.platform == "linux":
            s.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        s.setsockopt(
            socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + socket.inet_aton(local)
        )
    except OSError:
        s.close()
        raise
    return s


class ServerSockets:
    """UDP sockets through which a client exchanges datagrams with one motion-capture server.

    The sockets open when the network is available, and accept datagrams of this server only.

    server, port: destination of requests; the address is numeric.
    local: address of the local interface; None selects the interface that routes to the server.
    multicast: group and port to join, or None.
    counts: counter to which dropped datagrams are added.
    stamps: the kernel records the time at which each datagram arrives, and the receive buffers are larger: for a client that reads
        several datagrams at a time.
    """

    def __init__(
        self,
        server: tuple[str, int],
        local: str | None,
        multicast: tuple[str, int] | None,
        reception: Reception,
        counts: Counter[str],
        *,
        stamps: bool = False,
    ) -> None:
        self.local = local or "this computer"
        self.error = ""
        self._server, self._wanted_local, self._multicast = server, local, multicast
        self._reception, self._counts, self._stamps = reception, counts, stamps
        self._sockets: list[socket.socket] = []
        self._tried = -math.inf
        self._epoll = select.epoll()

    def fileno(self) -> int:
        return self._epoll.fileno()

    @property
    def is_open(self) -> bool:
        return bool(self._sockets)

    def open(self, wall: float) -> bool:
        """Open the sockets if the last try was more than 1 s ago. Return True if this call has opened them.

        wall: monotonic wall time [s].
        """
        if wall - self._tried < _RETRY_S:
            return False
        self._tried = wall
        try:
            self.local = self._wanted_local or local_address_for(*self._server)
            self._add(udp_socket(self.local, 0))
            if self._multicast is not None:
                self._add(multicast_socket(*self._multicast, self.local))
        except OSError as error:
            self.close_sockets()
            self.error = f"{self._wanted_local or 'no interface of this computer has a route to the server'}: {error.strerror}"
            self._counts["no network"] += 1
            return False
        self.error = ""
        return True

    def listen_on(self, port: int) -> None:
        """Open one more UDP socket, which receives datagrams on this port. Raises OSError.

        The interface of the computer is the same as that of the other sockets.
        """
        self._add(udp_socket(self.local, port))

    def read(self, wall: float) -> list[bytes]:
        """Return the datagrams that have arrived from the server, one socket after the other."""
        return [data for data, _ in self.read_stamped(wall)]

    def read_stamped(self, wall: float) -> list[tuple[bytes, float | None]]:
        """Return (datagram, monotonic time of arrival [s]) of each datagram that has arrived.

        The time is None if the option `stamps` is off.
        """
        if not self._stamps:
            server = self._server[0]
            return [
                (data, None)
                for s in self._sockets
                for data, sender in read_datagrams(s, _MAX_DATAGRAMS)
                if sender[0] == server or self._is_of_server(sender[0], wall)
            ]
        return [received for s in self._sockets for received in self._read(s, wall)]

    def send(self, data: bytes) -> None:
        """Send a request to the server. If the network does not accept the request, it is lost."""
        if not self._sockets:
            return
        try:
            self._sockets[0].sendto(data, self._server)
        except OSError:
            self._counts["not sent"] += 1

    def close_sockets(self) -> None:
        for s in self._sockets:
            s.close()
        self._sockets = []

    def close(self) -> None:
        self.close_sockets()
        self._epoll.close()

    def _add(self, s: socket.socket) -> None:
        self._sockets.append(s)
        if self._stamps:
            enable_stamps(s)
            with contextlib.suppress(OSError):
                s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _STAMPED_BUFFER_BYTES)
        self._epoll.register(s.fileno(), select.EPOLLIN)

    def _read(self, s: socket.socket, wall: float) -> list[tuple[bytes, float | None]]:
        """Return (datagram, monotonic time of arrival [s]) of each datagram of the server in a socket with time stamps."""
        found: list[tuple[bytes, float | None]] = []
        unix_s, monotonic_s = read_together(time.time)
        offset_s = monotonic_s - unix_s
        for _ in range(_MAX_DATAGRAMS):
            try:
                data, sender, stamp_s = receive_stamped(s)
            except OSError:
                break
            if self._is_of_server(sender[0], wall):
                found.append((data, None if stamp_s is None else stamp_s + offset_s))
        return found

    def _is_of_server(self, host: str, wall: float) -> bool:
        """Return whether a datagram was sent by the server. Record a datagram of another sender."""
        if host == self._server[0]:
            return True
        self._counts["foreign"] += 1
        self._reception.on_foreign(host, wall)
        return False
