"""Server of the emulated motion capture: sends multicast frames only while somebody of this computer can receive them."""

from __future__ import annotations

import socket
from collections import Counter

import pytest

from arena.closed_ports import ClosedPorts
from arena.mocap.emulator.interface import MeasuredFrame
from arena.mocap.emulator.udp_server import SEARCH_S, UdpServer
from arena.transport import Address

ADDRESS, GROUP = "127.51.2.1", "239.243.51.4"
FRAME = MeasuredFrame(7, 0.25, ())


class Protocol:
    """Protocol whose frames are their number, and that counts how often it encodes one."""

    def __init__(self, group: Address) -> None:
        self.counts: Counter[str] = Counter()
        self.group, self.encoded, self.began = group, 0, 0.0

    def begin(self, sent_s: float) -> None:
        self.began = sent_s

    def encode(self, frame: MeasuredFrame, sent_s: float) -> bytes:
        self.encoded += 1
        return b"%d" % frame.number

    def destinations(self, wall: float) -> list[Address]:
        return [self.group]

    def reply(self, data: bytes, sender: Address, wall: float) -> bytes | None:
        return b"reply"


@pytest.fixture
def port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind((GROUP, 0))
        found = one.getsockname()[1]
    return found


@pytest.fixture
def server(port):
    group = (GROUP, port)
    made = UdpServer(Protocol(group), (ADDRESS, 0), "a test", group=group)
    yield made
    made.close()


def listener(port: int) -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind((GROUP, port))
    one.setsockopt(
        socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + socket.inet_aton(ADDRESS)
    )
    one.settimeout(10)
    return one


def test_nothing_is_encoded_while_nobody_listens_but_frames_are_counted(server):
    assert server.send(FRAME, 0.5, 100.0) == 0
    assert (server._protocol.encoded, server._protocol.began, server.counts["frames"]) == (0, 0.5, 1)


def test_listener_is_found_at_the_next_search(server, port):
    server.send(FRAME, 0.5, 100.0)
    with listener(port) as one:
        server.send(FRAME, 0.5, 100.0 + SEARCH_S)
        assert one.recv(100) == b"7"


def test_listener_is_found_at_once_when_a_request_arrives(server, port):
    server.send(FRAME, 0.5, 100.0)
    with listener(port) as one, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.sendto(b"connect", server._requests.getsockname())
        server.answer(100.0)
        assert client.recv(100) == b"reply"
        server.send(FRAME, 0.5, 100.0)
        assert one.recv(100) == b"7"


def test_requests_cause_no_search_while_the_port_is_open(server, port, monkeypatch):
    with listener(port), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        server.send(FRAME, 0.5, 100.0)
        monkeypatch.setattr(ClosedPorts, "search", lambda _: pytest.fail("reads the table of all sockets"))
        client.sendto(b"echo", server._requests.getsockname())
        server.answer(100.0)
        client.settimeout(10)
        assert client.recv(100) == b"reply"


def test_group_of_a_real_network_is_always_served(port):
    group = (GROUP, port)
    server = UdpServer(Protocol(group), ("0.0.0.0", 0), "a test", group=group)
    server.send(FRAME, 0.5, 100.0)
    assert server._protocol.encoded == 1
    server.close()
