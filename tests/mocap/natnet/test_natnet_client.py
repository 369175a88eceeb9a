"""The NatNet client's sockets against a server in the test: requests, foreign senders, silence, unicast ports."""

from __future__ import annotations

import itertools
import os
import select
import socket
import time

import psutil
import pytest

from arena.errors import InputError
from arena.mocap.client import open_client
from arena.mocap.client.sockets import local_address_for, multicast_socket, udp_socket
from arena.mocap.natnet import client as natnet_client
from arena.mocap.natnet import codec as natnet
from tests.kernel_stamps import kernel_stamps  # noqa: F401 - a fixture of this module

V = (4, 1)
GROUP = "239.243.51.9"
_hosts = itertools.count(1)


class Server:
    """A NatNet server that the test steps; each test has its own address."""

    def __init__(self, net: str = "127.51.2.") -> None:
        self.host = f"{net}{next(_hosts)}"
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((self.host, 0))
        self.socket.settimeout(60)
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self.host))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((self.host, 0))
            self.data_port = probe.getsockname()[1]

    def settings(self, **changes):
        return {
            "kind": "natnet",
            "server": self.host,
            "local": self.host,
            "group": GROUP,
            "transport": "multicast",
            "command_port": self.socket.getsockname()[1],
            "data_port": self.data_port,
            "bodies": ["uav1"],
            **changes,
        }

    def wait_for(self, message: int) -> tuple[str, int]:
        """Wait for a request other than keepalives and return its sender."""
        while True:
            data, sender = self.socket.recvfrom(2048)
            if natnet.message_of(data) != natnet.KEEPALIVE:
                assert natnet.message_of(data) == message
                return sender

    def handshake(self, capture, streaming_id: int = 1) -> tuple[str, int]:
        sender = self.wait_for(natnet.CONNECT)
        info = natnet.ServerInfo(
            name="x", app_version=(4, 1, 0, 0), version=V, clock_hz=1, data_port=self.data_port, group=""
        )
        self.socket.sendto(natnet.encode_server_info(info), sender)
        until(capture, lambda: capture.core._version is not None)
        self.wait_for(natnet.REQUEST_MODELDEF)
        self.socket.sendto(natnet.encode_models([(streaming_id, "uav1")], V), sender)
        until(capture, lambda: capture.core.is_connected)
        return sender


def frame(number: int, *, bodies: int = 1) -> bytes:
    body = natnet.Body(streaming_id=1, position=(1.0, 2.0, 3.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0))
    return natnet.encode_frame(
        natnet.Frame(number=number, timestamp_s=1.0, exposure_ticks=0, bodies=(body,) * bodies), V
    )


def until(capture, done, deadline_s: float = 30.0) -> list:
    """Poll when there is something to read, or after 0.05 s, until done() is true. Return the frames."""
    found, end = [], time.monotonic() + deadline_s
    while not done():
        assert time.monotonic() < end, f"not done in {deadline_s:g} s: {capture.counts}"
        select.select([capture], [], [], 0.05)
        got = capture.poll(0.0)
        found += got
        if got and done is got_some:
            return found
    return found


def got_some() -> bool:
    return False


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A server that a busy machine keeps silent for 2 s gets no new handshake: the test does not answer a second one."""
    monkeypatch.setattr(natnet_client, "_SILENT_S", 60.0)


@pytest.fixture
def server():
    made = Server()
    yield made
    made.socket.close()


def test_second_request_follows_the_first_answer_at_once(server):
    capture = open_client(server.settings())
    server.handshake(capture)
    capture.close()


@pytest.mark.parametrize("stamps", [True, False])
def test_frames_that_wait_in_the_socket_have_the_time_of_their_arrival(server, stamps):
    capture = open_client(server.settings(stamps=stamps))
    server.handshake(capture)
    began = time.monotonic()
    for number in range(1, 41):
        server.socket.sendto(frame(number), (GROUP, server.data_port))
    sent, found = time.monotonic(), []
    while time.monotonic() < sent + 0.3:  # the frames wait in the socket
        os.sched_yield()
    while len(found) < 40:
        found += until(capture, got_some)
    assert [f.number for f in found] == list(range(1, 41))
    if stamps:
        late_s = 0.15  # a busy kernel delivers later than it sends; the frames then wait twice as long
        assert all(began - 0.02 <= f.arrived_s <= sent + late_s for f in found)
    else:
        assert all(f.arrived_s is None for f in found)
    capture.close()


def test_a_body_that_is_defined_again_without_notice_is_found(server):
    capture = open_client(server.settings())
    sender = server.handshake(capture)
    before = capture.definition("uav1")
    capture.refresh_definitions()
    server.wait_for(natnet.REQUEST_MODELDEF)
    server.socket.sendto(natnet.encode_models([(1, "uav1")], V, [(0.1, 0.0, 0.0)]), sender)
    until(capture, lambda: capture.definition("uav1") != before)
    assert capture.definition("uav1").startswith("markers ") and capture.core.is_connected
    capture.close()


def test_unanswered_request_is_repeated_without_blocking(server):
    capture = open_client(server.settings())
    server.wait_for(natnet.CONNECT)
    server.socket.settimeout(0.01)
    began, asked, used_s = time.monotonic(), 0, []
    while asked < 3:
        before = time.monotonic()
        assert before < began + 60.0, f"{asked} requests"
        capture.poll(0.0)
        used_s.append(time.monotonic() - before)
        try:
            server.wait_for(natnet.CONNECT)
            asked += 1
        except TimeoutError:
            pass
    capture.close()
    assert (
        time.monotonic() - began > 0.9
    )  # the second and the third request half a second after the one before
    assert sorted(used_s)[len(used_s) // 2] < 0.45  # the median: a busy machine may delay single calls


def test_foreign_frames_are_dropped_and_counted(server):
    capture = open_client(server.settings())
    server.handshake(capture)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.51.3.1", 0))
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(server.host))
        stranger.sendto(frame(1), (GROUP, server.data_port))
        assert until(capture, lambda: capture.counts["foreign"] > 0) == []
    server.socket.sendto(frame(2), (GROUP, server.data_port))
    assert [f.number for f in until(capture, got_some)] == [2]
    capture.close()


def test_other_group_on_the_same_port_is_not_received(server):
    """Two arenas on one computer share the data port; a receiver of each runs beside the other."""
    ours = open_client(server.settings())
    server.handshake(ours)
    theirs = open_client(server.settings(group="239.243.51.10"))
    server.socket.sendto(frame(1), ("239.243.51.10", server.data_port))
    until(theirs, lambda: theirs.counts["before the handshake"] == 1)
    server.socket.sendto(frame(2), (GROUP, server.data_port))
    assert [f.number for f in until(ours, got_some)] == [2]
    ours.close()
    theirs.close()


def test_unicast_frames_arrive_on_the_request_port(server):
    capture = open_client(server.settings(transport="unicast"))
    client = server.handshake(capture)
    server.socket.sendto(frame(1), client)
    assert [f.number for f in until(capture, got_some)] == [1]
    capture.close()


def test_unicast_frames_arrive_on_the_data_port(server):
    capture = open_client(server.settings(transport="unicast"))
    server.handshake(capture)
    until(capture, lambda: len(capture._sockets._sockets) == 2)
    server.socket.sendto(frame(1), (server.host, server.data_port))
    assert [f.number for f in until(capture, got_some)] == [1]
    capture.close()


def test_silent_server_gets_a_new_handshake(server, monkeypatch):
    capture = open_client(server.settings())
    server.handshake(capture)
    monkeypatch.setattr(natnet_client, "_SILENT_S", 2.0)
    until(capture, lambda: not capture.core.is_connected)
    server.wait_for(natnet.CONNECT)
    capture.close()


def test_unknown_vendor_is_an_input_error(server):
    with pytest.raises(InputError, match="expected one of natnet"):
        open_client(server.settings(kind="vrpn"))


def test_missing_network_is_reported_and_retried(server, monkeypatch):
    """A lab's Wi-Fi may come after the arena; a forwarder that gave up would leave its vehicle blind."""
    monkeypatch.setattr("arena.mocap.client.sockets._RETRY_S", 0.05)
    there = []

    def route(to, port):
        if not there:
            raise OSError(101, "Network is unreachable")
        return local_address_for(to, port)

    monkeypatch.setattr("arena.mocap.client.sockets.local_address_for", route)
    capture = open_client(server.settings(local=None))
    until(capture, lambda: capture.counts["no network"] > 2)
    assert "Network is unreachable" in capture.diagnosis() and server.host in capture.diagnosis()
    there.append(True)
    until(capture, lambda: not capture._sockets.error)
    server.handshake(capture)
    server.socket.sendto(frame(1), (GROUP, server.data_port))
    assert [f.number for f in until(capture, got_some)] == [1]
    assert capture.diagnosis() == ""
    capture.close()


def test_local_address_of_another_computer_is_reported(server):
    capture = open_client(server.settings(local="203.0.113.1"))
    assert "203.0.113.1" in capture.diagnosis()
    assert capture.poll(0.0) == []
    capture.close()


def test_two_servers_in_one_group_are_not_mixed(server):
    """The emulator and a real server, same group, same port, same streaming ids: each client accepts its own server only."""
    other = Server("127.73.2.")
    try:
        other.data_port = server.data_port
        ours, theirs = open_client(server.settings()), open_client(other.settings(local=None))
        server.handshake(ours)
        other.handshake(theirs)
        for n in range(1, 40):
            server.socket.sendto(frame(n), (GROUP, server.data_port))
            other.socket.sendto(frame(1000 + n), (GROUP, server.data_port))
        for capture, first in ((ours, 1), (theirs, 1001)):
            found = until(capture, lambda c=capture: c.counts["frames"] == 39 and c.counts["foreign"] == 39)
            assert [f.number for f in found] == list(range(first, first + 39))
        ours.close()
        theirs.close()
    finally:
        other.socket.close()


def test_group_joined_on_one_interface_is_not_received_on_another():
    """Linux would hand over what any program of the computer has joined anywhere."""
    with udp_socket("127.73.3.1", 0) as probe:
        port = probe.getsockname()[1]
    ours = multicast_socket(GROUP, port, "127.0.0.1")
    assert ours.getsockopt(socket.IPPROTO_IP, 49) == 0
    outside = [
        a.address for each in psutil.net_if_addrs().values() for a in each if a.family == socket.AF_INET
    ]
    outside = [a for a in outside if not a.startswith("127.")]
    if outside:  # the option's value is all that can be looked at on a computer with loopback alone
        theirs, speaker = multicast_socket(GROUP, port, outside[0]), udp_socket(outside[0], 0)
        speaker.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(outside[0]))
        speaker.sendto(b"frame", (GROUP, port))
        assert select.select([theirs], [], [], 5.0)[0]
        assert not select.select([ours], [], [], 0.0)[0]
        theirs.close()
        speaker.close()
    ours.close()


def test_two_bodies_with_one_id_are_reported_with_the_id(server, monkeypatch):
    monkeypatch.setattr("arena.mocap.client.reception._GRACE_S", 0.0)
    capture = open_client(server.settings())
    server.handshake(capture)
    server.socket.sendto(frame(1, bodies=2), (GROUP, server.data_port))
    until(capture, lambda: capture.counts["duplicate ids"])
    assert "two bodies with the id 1 ('uav1' is one of them)" in capture.diagnosis()
    capture.close()


def test_missing_body_is_reported_with_the_names_that_exist(server, monkeypatch):
    monkeypatch.setattr("arena.mocap.client.reception._GRACE_S", 0.0)
    capture = open_client(server.settings(bodies=["UAV1"]))
    assert "no answer" in capture.diagnosis()
    sender = server.wait_for(natnet.CONNECT)
    info = natnet.ServerInfo(
        name="x", app_version=(4, 1, 0, 0), version=V, clock_hz=1, data_port=9, group="239.1.1.1"
    )
    server.socket.sendto(natnet.encode_server_info(info), sender)
    until(capture, lambda: capture.core.answers)
    assert "239.1.1.1" in capture.diagnosis(), "it streams to another group"
    server.wait_for(natnet.REQUEST_MODELDEF)
    server.socket.sendto(natnet.encode_models([(1, "uav1"), (2, "wand")], V), sender)
    until(capture, lambda: capture.counts["unknown body"])
    server.socket.sendto(frame(1), (GROUP, server.data_port))
    until(capture, lambda: capture.counts["no wanted body"])
    for words in ("'UAV1'", "'uav1', 'wand'", "mean 'uav1'"):
        assert words in capture.diagnosis()
    capture.close()
