"""Setting that lets the Linux kernel send datagrams between processes of this computer with less work."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterable
from pathlib import Path

from arena.transport import MAX_DATAGRAM_BYTES, is_loopback

_IP_MTU_DISCOVER, _IP_PMTUDISC_PROBE = 10, 3  # linux/in.h; the socket module does not name them
_LOOPBACK_MTU = Path("/sys/class/net/lo/mtu")


def send_unfragmented(sockets: Iterable[socket.socket], mtu_file: Path = _LOOPBACK_MTU) -> None:
    """Make sockets at loopback addresses send their datagrams without fragments.

    The kernel then neither searches for the path MTU nor computes an identification, by which fragments are joined.
    Other sockets are not changed, and none is changed if the loopback device cannot carry the longest datagram.

    mtu_file: file that contains the longest packet of the loopback device [bytes].
    """
    with contextlib.suppress(OSError, ValueError):
        if int(mtu_file.read_text()) < MAX_DATAGRAM_BYTES:
            return
        for s in sockets:
            if is_loopback(s.getsockname()):
                s.setsockopt(socket.IPPROTO_IP, _IP_MTU_DISCOVER, _IP_PMTUDISC_PROBE)
