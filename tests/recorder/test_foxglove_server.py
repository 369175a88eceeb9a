"""WebSocket for Foxglove: what a plain client receives, and clients that do not read."""

from __future__ import annotations

import resource
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import closing

import pytest
from foxglove_clients import DEADLINE_S, Client, LiveMessage, hung_client
from viewer_records import SIZE_M, UAV1, attitude, position, sender

from arena.recorder.foxglove_channels import FoxgloveChannels
from arena.recorder.foxglove_server import BACKLOG_MESSAGES, FoxgloveServer
from arena.recorder.mcap_file import Log
from arena.recorder.mcap_records import SchemaData

LOOPBACK = "127.0.0.1"
POSITION = "/uav1/local_position"
Q_NB = (0.5, 0.5, -0.5, 0.5)


class Live:
    """Server with the channels of one vehicle."""

    def __init__(self, *, simulation_clock: bool = True) -> None:
        self.server = FoxgloveServer(LOOPBACK, 0, "lab", simulation_clock=simulation_clock)
        self.channels = FoxgloveChannels([UAV1], self._channel, size_m=SIZE_M)
        self.sent = 0

    def _channel(self, topic: str, encoding: str, schema: SchemaData) -> Log:
        return self.server.channel(topic, encoding, schema, lambda data, log_time: None)

    def fly(self, messages: int) -> None:
        """Log positions and attitudes. messages: number of positions."""
        out = sender()
        for _ in range(messages):
            self.sent += 1
            time_s = 0.1 * self.sent
            data = position((0.001 * self.sent, 0.0, -1.0)).pack(out) + attitude(Q_NB).pack(out)
            self.channels.on_datagrams([("uav1", False, data, time_s)])
            self.server.pass_time(time_s)

    @property
    def last_time(self) -> int:
        """Log time of the last position [ns]."""
        return round(0.1 * self.sent * 1e9)

    def client(self) -> Client:
        return Client(LOOPBACK, self.server.port or 0)

    def subscribed(self, topic: str) -> Client:
        """Return a client that receives a topic: messages are logged until the first of them arrives."""
        made = self.client()
        made.subscribe(topic)
        deadline = time.monotonic() + DEADLINE_S
        while time.monotonic() < deadline:
            self.fly(1)
            if messages(made, 0.05):
                return made
        raise AssertionError("the client has received no message")

    def hung(self) -> socket.socket:
        """Return a connection that has subscribed to all topics and reads nothing."""
        with closing(self.client()) as other:
            other.subscribe(POSITION, "/tf", "/scene", "/log")  # all of them are advertised then
            return hung_client(LOOPBACK, self.server.port or 0, other.topics.values())


def messages(client: Client, timeout_s: float) -> list[LiveMessage]:
    """Return the messages of topics until none arrives for `timeout_s` [s]."""
    return [message for message in client.received(timeout_s) if message.topic]


def received_until(client: Client, log_time: int) -> list[int]:
    """Return the log times [ns] of the messages of topics up to the one of `log_time` [ns]."""
    found = []
    for message in client.received(DEADLINE_S):
        if message.topic:
            found.append(message.log_time)
            if message.log_time == log_time:
                return found
    raise AssertionError(f"the message of {log_time} ns has not arrived, {len(found)} others have")


def all_until(client: Client, topics: set[str], log_time: int) -> list[LiveMessage]:
    """Return all messages until each topic has one with this log time [ns]. Topic "" is the time of the server."""
    found, missing = [], set(topics)
    for message in client.received(DEADLINE_S):
        found.append(message)
        missing -= {message.topic} if message.log_time == log_time else set()
        if not missing:
            return found
    raise AssertionError(f"the message of {log_time} ns has not arrived, {len(found)} others have")


@pytest.fixture
def live() -> Iterator[Live]:
    made = Live()
    assert not made.server.failure
    yield made
    made.server.close()


def test_client_receives_every_message_with_simulation_time(live):
    with closing(live.subscribed(POSITION)) as client:
        assert client.info["name"] == "lab" and "time" in client.info["capabilities"]
        assert {POSITION, "/tf", "/scene", "/log"} <= set(client.topics)
        first = live.sent
        live.fly(200)
        found = all_until(client, {POSITION, ""}, live.last_time)
    positions = [m for m in found if m.topic == POSITION and m.log_time > round(0.1 * first * 1e9)]
    assert [m.log_time for m in positions] == [round(0.1 * (first + k + 1) * 1e9) for k in range(200)]
    assert struct.unpack_from("<3f", positions[-1].data, 4) == pytest.approx((0.001 * live.sent, 0.0, -1.0))
    assert max(m.log_time for m in found if not m.topic) == positions[-1].log_time


def test_client_that_connects_late_receives_the_scene(live):
    live.fly(300)
    with closing(live.subscribed("/scene")) as client:
        live.fly(200)
        assert any(b"walls" in message.data for message in client.received(DEADLINE_S))


def test_hung_client_neither_delays_the_channels_nor_needs_memory(live):
    with closing(live.hung()), closing(live.subscribed(POSITION)) as client:
        for _ in range(4):  # fills the socket and the backlog of the hung client
            live.fly(BACKLOG_MESSAGES // 2)
            received_until(client, live.last_time)
        memory_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        worst_s, count = 0.0, 0
        for _ in range(8):
            for _ in range(BACKLOG_MESSAGES // 2):
                began = time.monotonic()
                live.fly(1)
                worst_s = max(worst_s, time.monotonic() - began)
            count += len(received_until(client, live.last_time))
        assert count == 4 * BACKLOG_MESSAGES  # the other client loses nothing
        assert worst_s < 10.0  # a hung client would delay it for ever
        grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory_kb
        assert grown_kb < 20_000


def test_client_that_disappears_changes_nothing_for_the_others(live, caplog):
    gone = live.hung()
    live.fly(100)
    gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    gone.close()  # sends a reset
    with closing(live.subscribed(POSITION)) as client:
        first = live.sent
        live.fly(50)
        times = received_until(client, live.last_time)
    assert [t for t in times if t > round(0.1 * first * 1e9)] == [
        round(0.1 * (first + k + 1) * 1e9) for k in range(50)
    ]
    assert not caplog.records  # not a line for each message that waited


def test_port_in_use_is_a_failure_and_not_an_exception(live):
    second = FoxgloveServer(LOOPBACK, live.server.port or 0, "lab", simulation_clock=False)
    assert f"{LOOPBACK}:{live.server.port}" in second.failure
    assert second.port is None
    second.pass_time(1.0)
    second.close()


def test_unix_time_is_not_sent():
    live = Live(simulation_clock=False)
    with closing(live.server), closing(live.subscribed(POSITION)) as client:
        assert client.info["capabilities"] == []
        live.fly(10)
        assert {m.topic for m in all_until(client, {POSITION}, live.last_time)} == {POSITION}


def test_server_without_clients_ends_at_once():
    live = Live()
    began = time.monotonic()
    live.server.close()
    live.server.close()
    assert time.monotonic() - began < DEADLINE_S
