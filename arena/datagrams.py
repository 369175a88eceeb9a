"""Function that reads the datagrams that wait in a UDP socket, many with one system call if the kernels are compiled."""

from __future__ import annotations

import socket

from arena.kernels import INTERPRETED
from arena.transport import MAX_DATAGRAM_BYTES, Address


def read_singly(source: socket.socket, limit: int) -> list[tuple[bytes, Address]]:
    """Read waiting datagrams as `read_datagrams` does, but with one system call per datagram.

    The socket must not block.
    """
    found: list[tuple[bytes, Address]] = []
    for _ in range(limit):
        try:
            found.append(source.recvfrom(MAX_DATAGRAM_BYTES))
        except OSError:
            break
    return found


if INTERPRETED is None:
    from arena.kernels import datagram_batch

    def read_datagrams(source: socket.socket, limit: int) -> list[tuple[bytes, Address]]:
        """Return (datagram, sender) of the datagrams that have arrived at an IPv4 socket, oldest first. Never waits.

        limit: largest number of datagrams, so that a flood on one socket does not delay the other sockets
        An error of the network ends the reading, as an empty socket does; the next call continues.
        """
        return datagram_batch.read_datagrams(source.fileno(), limit)

else:
    read_datagrams = read_singly
