"""Guard of one vehicle's simulator port (TCP): accepts connections from PX4, and closes all others.

Any program may connect to a TCP port: a port scanner, a browser, a second PX4 with the same id. The guard
ensures that none of them replaces the vehicle's PX4. A client counts as PX4 once it has sent valid MAVLink,
which PX4 does at once.
"""

from __future__ import annotations

import contextlib
import socket
from collections import Counter

from arena.errors import RunError
from arena.wire.mavlink_frame import Stream

IDENTIFY_TIMEOUT_S = 2.0
"""Wall time within which a client must have sent valid MAVLink [s]."""
_MAX_CLIENTS = 4  # clients that have not sent valid MAVLink yet
_BYTES = 4096


class _Client:
    """TCP connection of a client that must still prove that it is PX4, by sending valid MAVLink.

    since: wall time of its start [s]
    data: all bytes that the client has sent
    """

    def __init__(self, connection: socket.socket, peer: str, since: float) -> None:
        self.connection, self.peer, self.since = connection, peer, since
        self.data = b""
        self._stream = Stream()

    def check(self, now: float) -> str | None:
        """Read what the client has sent, and decide whether the client is PX4.

        Returns None while the check is not complete, "" if the client is PX4, else the reason to refuse the
        client.
        """
        waiting = (
            None
            if now - self.since < IDENTIFY_TIMEOUT_S
            else f"sent nothing valid within {IDENTIFY_TIMEOUT_S:g} s"
        )
        try:
            data = self.connection.recv(_BYTES)
        except BlockingIOError:
            return waiting
        except OSError:
            data = b""
        if not data:
            return "closed the connection before it sent anything valid"
        self.data += data
        _, found = self._stream.feed(data)
        if len(found.frames) > found.unknown:
            return ""
        if found.garbage or found.unknown:
            return "does not send MAVLink"
        return waiting


class ConnectionGuard:
    """Listener on a vehicle's simulator port (TCP) that accepts a client only if it is PX4.

    name: name of the vehicle
    address: address to listen on
    counts: refused clients: "strangers" are not PX4, "refused" came while a PX4 is connected
    events: new event lines of the run

    Raises RunError if the port is taken.
    """

    def __init__(self, name: str, address: tuple[str, int]) -> None:
        self._name, self._address = name, address
        self._clients: list[_Client] = []
        self._reported: set[str] = set()
        self.counts: Counter[str] = Counter()
        self.events: list[str] = []
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind(address)
        except OSError as error:
            self._listener.close()
            raise RunError(
                f"{name}: cannot serve the simulator API on {address[0]}:{address[1]}: {error.strerror}."
                " Does another arena run on this address?"
            ) from error
        self._listener.listen(_MAX_CLIENTS)
        self._listener.setblocking(False)

    def accept(self, now: float, *, taken: bool) -> tuple[socket.socket, bytes] | None:
        """Return (connection, bytes received so far) of a new client that is PX4, or None if there is none.

        now: wall time [s]
        taken: whether a PX4 is connected, so that every other client is refused
        """
        while (client := self._next(now)) is not None:
            # our own PX4s connect from one of these two
            if client.peer.rpartition(":")[0] not in (self._address[0], "127.0.0.1"):
                self._clients.append(client)
                self._reject(client, "comes from another address than this computer's")
            elif taken or len(self._clients) >= _MAX_CLIENTS:
                self._refuse(client)
            else:
                self._clients.append(client)
        for client in list(self._clients):
            refusal = client.check(now)
            if refusal == "":
                self._clients.remove(client)
                self._refuse_all()
                return client.connection, client.data
            if refusal:
                self._reject(client, refusal)
        return None

    def close(self) -> None:
        """Close the sockets of the port and of all clients that are not accepted yet."""
        self._listener.close()
        for client in self._clients:
            client.connection.close()

    def _next(self, now: float) -> _Client | None:
        try:
            connection, (host, port) = self._listener.accept()
        except OSError:
            return None
        connection.setblocking(False)
        with contextlib.suppress(OSError):  # it is closed already
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return _Client(connection, f"{host}:{port}", now)

    def _refuse_all(self) -> None:
        for client in self._clients:
            self._refuse(client)
        self._clients = []
        self._reported.discard("refused")

    def _refuse(self, client: _Client) -> None:
        client.connection.close()
        self.counts["refused"] += 1
        self._report(
            "refused",
            f"a connection from {client.peer} was refused: a PX4 is already connected, or is connecting now",
        )

    def _reject(self, client: _Client, why: str) -> None:
        self._clients.remove(client)
        client.connection.close()
        self.counts["strangers"] += 1
        self._report(why, f"a connection from {client.peer} was closed: it {why}, so it is not PX4")

    def _report(self, kind: str, text: str) -> None:
        """Report a closed connection as an event, unless its reason (`kind`) was already reported.

        So a port scanner that connects often is reported only once. After PX4 has connected, `refused` can be reported again.
        """
        if kind not in self._reported:
            self._reported.add(kind)
            host, port = self._address
            self.events.append(f"{self._name}: simulator port {host}:{port}: {text}")
