"""The sockets of a receiver: on one interface, and deaf to what other programs of this computer joined on another."""

from __future__ import annotations

import socket
import sys

_IP_MULTICAST_ALL = 49  # linux/in.h; the socket module does not name it


def local_for(server: str, port: int) -> str:
    """The address of the interface whose route leads to the server. Nothing is sent. Raises OSError when no route does."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.connect((server, port))
        return str(s.getsockname()[0])


def udp(address: str, port: int) -> socket.socket:
    """Raises OSError."""
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        s.setblocking(False)
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1 if port else 0)
        s.bind((address, port))
    except OSError:
        s.close()
        raise
    return s


def member(group: str, port: int, local: str) -> socket.socket:
    """A socket in a multicast group on one interface, bound to the group so that others on the port are not heard.

    Linux gives such a socket every datagram of the group that reaches the computer, whichever interface another program joined
    it on, unless it is told not to. Raises OSError.
    """
    s = udp(group, port)
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
