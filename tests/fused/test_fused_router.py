"""The router of the fused arena: messages of ground stations and built-in autopilots pass in memory on the link for ground stations."""

from __future__ import annotations

import random
import socket
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.fused.memory_links import RecorderLink
from arena.fused.router import FusedRouter

HOST, STATION = "127.56.0.1", ("127.56.0.1", 14550)


def packed(message, system, component):
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component)))


@pytest.fixture
def station():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(STATION)
        made.settimeout(60.0)
        yield made


def make_router(recorder=None):
    """Return a router of one built-in autopilot, and the inbox of the autopilot."""
    vehicle = {
        "name": "uav1",
        "id": 1,
        "link": {"local": [HOST, 24011], "remote": [HOST, 24010]},
        "ground": {"local": [HOST, 27003], "remote": [HOST, 27002]},
        "serve": [HOST, 24018],
        "clients": [{"name": "program", "address": [HOST, 16001]}, {"name": "sdk", "address": [HOST, 22001]}],
        "tools": [HOST, 24016],
    }
    settings = {
        "vehicles": [vehicle],
        "gcs_local": [HOST, 24000],
        "gcs": [{"name": "gcs", "address": list(STATION)}],
        "recorder": recorder,
        "heartbeat": True,
        "simulated": True,
        "seed": 1,
    }
    inbox = []
    ignore = dict.fromkeys(("audit", "event", "facts", "ready", "stats"), lambda *_: None)
    return FusedRouter(SimpleNamespace(settings=settings, **ignore), lambda: 1.0, {0}, inbox), inbox


@pytest.fixture
def routed(station):
    router, inbox = make_router()
    yield router, inbox
    router.close()


def test_command_of_a_ground_station_arrives_on_its_link_only(station, routed):
    router, inbox = routed
    data = packed(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0), 255, 190)
    station.sendto(data, (HOST, 24000))
    router.drain(1.0)
    assert inbox == [(0, "ground", data)]


def test_ground_station_receives_the_streams_of_its_link_only(station, routed):
    router, _ = routed
    for link, roll in (("router", 0.1), ("ground", 0.2)):
        message = mavlink.MAVLink_attitude_message(5, roll, 0, 0, 0, 0, 0)
        router.from_vehicle(0, packed(message, 1, 1), 1.0, link)
    (received,) = mavlink.MAVLink(None).parse_buffer(station.recv(1000))
    assert received.roll == pytest.approx(0.2)
    station.setblocking(False)
    with pytest.raises(BlockingIOError):
        station.recv(1000)


def test_telemetry_of_a_sleeping_program_arrives_as_one_datagram(routed):
    router, _ = routed
    asleep = {"uav1"}
    router.hold_for_sleepers({"uav1": "uav1"}, asleep)
    messages = [packed(mavlink.MAVLink_attitude_message(5, k / 10, 0, 0, 0, 0, 0), 1, 1) for k in range(3)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.bind((HOST, 16001))
        program.setblocking(False)
        for data in messages:
            router.from_vehicle(0, data, 1.0)
        with pytest.raises(BlockingIOError):
            program.recv(1000)
        asleep.clear()
        router.held.before_wake("uav1")
        assert program.recv(1000) == b"".join(messages)


def test_closed_port_receives_nothing_until_its_program_is_found_or_sends(routed):
    router, _ = routed
    attitude = packed(mavlink.MAVLink_attitude_message(5, 0.1, 0, 0, 0, 0, 0), 1, 1)
    router.closed.search()
    assert router.closed.now == {(HOST, 22001)}  # the ground station of this test listens
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sdk:
        sdk.bind((HOST, 22001))
        sdk.settimeout(60.0)
        router.from_vehicle(0, attitude, 1.0)
        sdk.sendto(packed(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), 1, 194), (HOST, 24018))
        router.drain(1.0)
        assert not router.closed.now
        router.from_vehicle(0, attitude, 1.0)
        assert sdk.recv(1000) == attitude
        sdk.setblocking(False)
        with pytest.raises(BlockingIOError):
            sdk.recv(1000)


def test_port_that_a_search_finds_open_or_closed_receives_or_not(routed):
    router, _ = routed
    attitude = packed(mavlink.MAVLink_attitude_message(5, 0.1, 0, 0, 0, 0, 0), 1, 1)
    router.closed.search()
    router.from_vehicle(0, attitude, 1.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sdk:
        sdk.bind((HOST, 22001))
        sdk.setblocking(False)
        router.from_vehicle(0, attitude, 1.0)
        with pytest.raises(BlockingIOError):
            sdk.recv(1000)
        router.closed.search()
        router.from_vehicle(0, attitude, 1.0)
        assert sdk.recv(1000) == attitude
        router.closed.now = frozenset({(HOST, 22001)})  # as after a search that finds it closed
        router.from_vehicle(0, attitude, 1.0)
        with pytest.raises(BlockingIOError):
            sdk.recv(1000)


def test_program_reaches_the_autopilot_on_the_router_link(station, routed):
    router, inbox = routed
    data = packed(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), 1, 191)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.bind((HOST, 16001))
        program.sendto(data, (HOST, 24018))
        router.drain(1.0)
    assert inbox == [(0, "router", data)]


def test_telemetry_is_not_joined_while_a_fault_impairs_a_link(routed):
    """Measurements of relative sensors need datagrams of their own, and a fault delays these, too."""
    router, _ = routed
    router.hold_for_sleepers({"uav1": "uav1"}, {"uav1"})
    whole = router._router
    router._impaired = SimpleNamespace(
        active=True,
        on_datagram=lambda key, sender, data, now, sim_now: whole.on_datagram(key, sender, data, now),
    )
    attitude = packed(mavlink.MAVLink_attitude_message(5, 0.1, 0, 0, 0, 0, 0), 1, 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.bind((HOST, 16001))
        program.settimeout(60.0)
        for _ in range(2):
            router.from_vehicle(0, attitude, 1.0)
            assert program.recv(1000) == attitude


def test_tool_stays_connected_in_a_simulation_that_is_faster_than_its_heartbeats(routed):
    router, _ = routed
    heartbeat = packed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), 240, 190)
    attitude = packed(mavlink.MAVLink_attitude_message(5, 0.1, 0, 0, 0, 0, 0), 1, 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tool:
        tool.bind((HOST, 0))
        tool.settimeout(60.0)
        tool.sendto(heartbeat, (HOST, 24016))
        router.drain(1.0)
        router.step(61.0)  # a minute of simulation, in which the tool has had no time for another heartbeat
        router.from_vehicle(0, attitude, 61.0)
        assert tool.recv(1000) == attitude


def telemetry(rng):
    """Return the messages of one step: ordinary telemetry, status, replies to one client, and messages of other links."""
    frames = {
        "ordinary": mavlink.MAVLink_attitude_message(0, *[rng.random()] * 6),
        "position": mavlink.MAVLink_local_position_ned_message(0, *[rng.random()] * 6),
        "status": mavlink.MAVLink_heartbeat_message(2, 12, 129, 6 << 16, 4, 3),
        "reply": mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190),
        "foreign": mavlink.MAVLink_attitude_message(0, *[0.0] * 6),
    }
    found = []
    for _ in range(rng.randrange(4)):
        kinds = rng.choices(list(frames), [8, 4, 1, 1, 1], k=rng.randrange(1, 4))
        data = b"".join(packed(frames[kind], 9 if kind == "foreign" else 1, 1) for kind in kinds)
        found.append((0, rng.choice(("router", "router", "ground", "vision")), data))
    return found


class Receivers:
    """Sockets of a program, of an SDK and of a ground station."""

    def __init__(self):
        self.sockets = {}
        for name, port in (("program", 16001), ("gcs", 14550)):
            self.sockets[name] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.sockets[name].bind((HOST, port))
            self.sockets[name].setblocking(False)

    def take(self):
        found = {name: b"" for name in self.sockets}
        for name, each in self.sockets.items():
            try:
                while True:
                    found[name] += each.recv(65536)
            except BlockingIOError:
                pass
        return found

    def close(self):
        for each in self.sockets.values():
            each.close()


def delivered(compiled):
    """Send random telemetry through a router. Return what its receivers got after each step, and the counts of the router."""
    rng, receivers, asleep = random.Random(5), Receivers(), set()
    router, _ = make_router(recorder=[HOST, 24020])
    link = RecorderLink(
        (HOST, 24020),
        router.sockets,
        [{"name": "uav1", "id": 1, "serve": [HOST, 24018], "tools": [HOST, 24016]}],
    )
    router.hold_for_sleepers({"uav1": "uav1"}, asleep)
    router.record_in(link)
    found, left_over = [], []
    try:
        for step in range(400):
            now = 0.004 * step
            (asleep.add if rng.random() < 0.6 else asleep.discard)("uav1")
            if "uav1" not in asleep:
                router.held.before_wake("uav1")
            messages, at = telemetry(rng), -1
            while (at := router.deliver(messages, at + 1, now) if compiled else at + 1) < len(messages):
                vehicle, name, data = messages[at]
                if name == "vision":
                    left_over.append(data)
                else:
                    router.from_vehicle(vehicle, data, now, name)
            router.held.step(now)
            found.append((receivers.take(), link.receive(now)))
    finally:
        counts = router.stats()
        router.close()
        link.close()
        receivers.close()
    return found, left_over, counts


def test_compiled_delivery_equals_the_routing_of_each_message():
    one, other = delivered(compiled=False), delivered(compiled=True)
    assert one == other
    received = [got for got, _ in one[0]]
    assert all(any(got[name] for got in received) for name in ("program", "gcs"))
    assert one[1] and sum(len(records) for _, records in one[0]) > 100
