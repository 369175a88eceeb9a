"""The router of the fused arena: messages of ground stations and built-in autopilots pass in memory on the link for ground stations."""

from __future__ import annotations

import socket
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import common as mavlink

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


@pytest.fixture
def routed(station):
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
        "recorder": None,
        "heartbeat": True,
        "simulated": True,
        "seed": 1,
    }
    inbox = []
    ignore = dict.fromkeys(("audit", "event", "facts", "ready", "stats"), lambda *_: None)
    router = FusedRouter(SimpleNamespace(settings=settings, **ignore), lambda: 1.0, {0}, inbox)
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
