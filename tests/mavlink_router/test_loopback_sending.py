"""The setting that sends datagrams on loopback without fragments, on real sockets."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import pytest

from arena.mavlink_router.loopback_sending import send_unfragmented

HOST, EVERYWHERE = "127.54.14.1", "0.0.0.0"
IP_MTU_DISCOVER, WANT, PROBE = 10, 1, 3  # linux/in.h
LONGEST = 65507  # payload of an IPv4 datagram [bytes]


@contextlib.contextmanager
def udp(host: str) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind((host, 0))
        s.setblocking(False)
        yield s


@pytest.mark.parametrize(
    ("host", "mtu", "expected"),
    [
        (HOST, "65536\n", PROBE),
        (HOST, "1500\n", WANT),
        (HOST, "", WANT),
        (HOST, None, WANT),
        (EVERYWHERE, "65536\n", WANT),
    ],
)
def test_only_loopback_sockets_with_a_long_mtu_are_changed(tmp_path, host, mtu, expected):
    mtu_file = tmp_path / "mtu"
    if mtu is not None:
        mtu_file.write_text(mtu)
    with udp(host) as s:
        s.setsockopt(socket.IPPROTO_IP, IP_MTU_DISCOVER, WANT)
        send_unfragmented([s], mtu_file)
        assert s.getsockopt(socket.IPPROTO_IP, IP_MTU_DISCOVER) == expected


def test_longest_datagram_still_arrives():
    with udp(HOST) as source, udp(HOST) as receiver:
        send_unfragmented([source])
        source.sendto(bytes(LONGEST), receiver.getsockname())
        assert receiver.recv(1 << 16) == bytes(LONGEST)
