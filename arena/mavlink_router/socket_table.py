"""Table of the router's sockets: the address of each socket, and the method that processes its datagrams."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from arena.authority import Role
from arena.mavlink_router.endpoints import Endpoint, Out
from arena.transport import Address, is_loopback
from arena.wire.mavlink_frame import Buffer

Handler = Callable[[Address, Buffer, float], list[Out]]
"""Returns the datagrams to send. Arguments: sender and content of a received datagram, and its time of arrival, monotonic [s]."""
_ANY_ADDRESS = ("0.0.0.0", 0)


class SocketTable:
    """Sockets of a router: their addresses, and the methods that process their datagrams.

    addresses: addresses to bind. handlers: processes the datagrams of the socket with the same index.
    """

    def __init__(self) -> None:
        self.addresses: list[Address] = []
        self.handlers: list[Handler] = []

    def add(self, local: Address, handler: Handler) -> int:
        """Add a socket to the table and return its index. local: address to bind."""
        self.addresses.append(local)
        self.handlers.append(handler)
        return len(self.addresses) - 1

    def serve(
        self, local: Address, handler: Handler, clients: Iterable[Address], role: Role = Role.PROGRAM
    ) -> dict[Address, Endpoint]:
        """Add the socket that exchanges messages with `clients`. Return {address: endpoint} of the clients.

        If this socket is bound to loopback, it cannot send to other computers: clients on other computers get a second socket.
        local: address to bind. handler: processes the received datagrams. role: role of the clients.
        """
        near = self.add(local, handler)
        far = {c for c in clients if is_loopback(local) and not is_loopback(c)}
        wide = self.add(_ANY_ADDRESS, handler) if far else near
        return {c: Endpoint(socket=wide if c in far else near, address=c, role=role) for c in clients}
