"""The mission protocol on the ground: uploads, downloads and their errors, as on PX4 v1.16."""

from __future__ import annotations

import math
from typing import Any

import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink
from scenarios import ALT, LAT, LON, RELATIVE, do, item, lat_lon, waypoint

SQUARE = [item(22, up=2.0), waypoint(2, 0, 2, 1.0, 0.4, -90.0), do(178, 1, 2.5, -1), do(177, 1, 3), item(21)]
ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE, INVALID = 1, 2, 3, 4, 5


def ready(**settings: Any) -> Flight:
    """Return a flight of one vehicle that may be armed, with an origin and a ground station."""
    flight = Flight(1, **settings)
    # a ground station whose heartbeat never stops
    flight.pilots.vehicles[0].gcs_heartbeat_at = 1e9
    flight.pilots.interfaces[0].links["router"].gcs_heartbeat_at = 1e9
    flight.send(
        0,
        mavlink.MAVLink_set_gps_global_origin_message(1, int(LAT * 1e7), int(LON * 1e7), int(ALT * 1e3), 0),
        "vision",
    )
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm and f.pilots.vehicles[0].home_n is not None, 20)
    return flight


def messages(flight: Flight, kind: str) -> list[Any]:
    return [m for m in flight.received[0] if m.get_type() == kind]


def texts(flight: Flight) -> str:
    """Return all STATUSTEXT, joined."""
    return "".join(m.text for m in messages(flight, "STATUSTEXT"))


def send_item(flight: Flight, seq: int, it: dict, kind: int = 0) -> None:
    auto, current = it.get("auto", 1), it.get("current", 0)
    flight.send(
        0,
        mavlink.MAVLink_mission_item_int_message(
            1,
            1,
            seq,
            it["frame"],
            it["command"],
            current,
            auto,
            *it["params"],
            it["x"],
            it["y"],
            it["z"],
            kind,
        ),
    )


def upload(flight: Flight, items: list[dict], kind: int = 0) -> int:
    """Upload a list and return the result of MISSION_ACK."""
    flight.received.forget(0)
    flight.send(0, mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for _ in range(20 + 5 * len(items)):
        flight.run(0.02)
        messages_received, flight.received[0] = flight.received[0], []
        for m in messages_received:
            if m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                send_item(flight, m.seq, items[m.seq], kind)
            elif m.get_type() == "MISSION_ACK":
                flight.run(0.1)
                flight.received[0] = messages_received + flight.received[0]
                return int(m.type)
    raise AssertionError("the upload was never acknowledged")


def download(flight: Flight, kind: int = 0) -> list[Any]:
    """Download a list as MISSION_ITEM_INT."""
    flight.received.forget(0)
    flight.send(0, mavlink.MAVLink_mission_request_list_message(1, 1, kind))
    flight.run(0.02)
    count = messages(flight, "MISSION_COUNT")[-1].count
    for seq in range(count):
        flight.send(0, mavlink.MAVLink_mission_request_int_message(1, 1, seq, kind))
        flight.run(0.02)
    flight.send(0, mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
    found = messages(flight, "MISSION_ITEM_INT")
    assert [m.seq for m in found] == list(range(count))
    return found


@pytest.fixture(scope="module")
def station():
    return ready()


@pytest.fixture(autouse=True)
def cleared(station):
    """No list and no transfer of the test before."""
    station.run(0.02)
    station.send(0, mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0))
    station.send(0, mavlink.MAVLink_mission_clear_all_message(1, 1, 255))
    station.run(0.04)
    station.received.forget(0)


def test_download_returns_the_items_as_px4_stores_them(station):
    assert upload(station, SQUARE) == 0
    back = download(station)
    assert [m.command for m in back] == [22, 16, 178, 177, 21]
    assert [m.frame for m in back] == [RELATIVE, RELATIVE, 2, 2, RELATIVE]
    assert (back[1].x, back[1].y) == lat_lon(2, 0)
    assert (back[1].param1, round(back[1].param2, 3), back[1].param4, back[1].z) == (1.0, 0.4, 270.0, 2.0)
    assert (back[3].param1, back[3].param2) == (1, 3)
    assert math.isnan(back[0].param4) and back[0].param1 == 0.0


def test_list_id_changes_with_the_list_and_is_announced(station):
    missions = station.pilots.vehicles[0].missions
    upload(station, SQUARE)
    first = missions.ids[0]
    upload(station, SQUARE[:2])
    second = missions.ids[0]
    assert len({0, first, second}) == 3
    upload(station, SQUARE)
    assert missions.ids[0] == first
    raw = station.pilots.interfaces[0].mission_protocol._current().pack(mavlink.MAVLink(None))
    assert first.to_bytes(4, "little") in raw


@pytest.mark.parametrize(
    ("bad", "result"),
    [
        ({**item(16), "frame": 1}, UNSUPPORTED_FRAME),
        ({**item(16), "frame": 10}, UNSUPPORTED_FRAME),
        (item(18), UNSUPPORTED),
        (do(16), UNSUPPORTED),
        (do(201, 7), 6),
        (item(5001, p=(4.0,)), ERROR),
        (item(16, up=math.nan), INVALID),
        ({**item(16), "x": 2_000_000_000}, INVALID),
    ],
)
def test_invalid_item_is_refused_and_leaves_the_old_list(station, bad, result):
    assert upload(station, SQUARE) == 0
    assert upload(station, [SQUARE[0], bad]) == result
    assert [m.command for m in download(station)] == [22, 16, 178, 177, 21]


def test_mission_request_int_is_used_once_the_client_sent_one():
    station = ready()
    station.send(0, mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    station.run(0.04)
    assert messages(station, "MISSION_REQUEST") and not messages(station, "MISSION_REQUEST_INT")
    send_item(station, 0, SQUARE[0])
    station.run(0.04)
    assert [m.seq for m in messages(station, "MISSION_REQUEST_INT")] == [1]


def test_too_many_items_are_refused_at_once(station):
    for kind, most in ((0, 10000), (1, 64), (2, 32)):
        station.received.forget(0)
        station.send(0, mavlink.MAVLink_mission_count_message(1, 1, most + 1, kind))
        station.run(0.04)
        assert [m.type for m in messages(station, "MISSION_ACK")] == [NO_SPACE]


def test_lost_item_is_requested_again_and_upload_ends_after_5_s(station):
    upload(station, SQUARE)
    station.received.forget(0)
    station.send(0, mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    station.run(1.0)
    assert 3 <= len(messages(station, "MISSION_REQUEST_INT")) <= 5
    send_item(station, 0, SQUARE[0])
    station.run(5.5)
    assert "Operation timeout" in texts(station)
    assert len(station.pilots.vehicles[0].missions.items[0]) == len(SQUARE)
    assert upload(station, SQUARE[:2]) == 0


def test_items_out_of_order_are_ignored_and_a_repeated_last_one_acknowledged(station):
    station.send(0, mavlink.MAVLink_mission_count_message(1, 1, 1, 0))
    send_item(station, 1, SQUARE[1])
    assert station.pilots.vehicles[0].missions.items[0] == ()
    for _ in range(2):
        send_item(station, 0, SQUARE[0])
    station.run(0.04)
    assert [m.type for m in messages(station, "MISSION_ACK")] == [0, 0]


def test_one_upload_at_a_time_over_all_links(station):
    station.send(0, mavlink.MAVLink_mission_count_message(1, 1, 2, 0), "panic")
    station.received.forget(0)
    station.send(0, mavlink.MAVLink_mission_count_message(1, 1, 2, 0), "router")
    station.run(0.04)
    assert [m.type for m in messages(station, "MISSION_ACK")] == [ERROR]
    station.send(
        0, mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0), "panic"
    )


def test_request_out_of_order_ends_a_download(station):
    upload(station, SQUARE)
    station.received.forget(0)
    station.send(0, mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    station.send(0, mavlink.MAVLink_mission_request_int_message(1, 1, 3, 0))
    station.run(0.04)
    assert [m.type for m in messages(station, "MISSION_ACK")] == [ERROR]
    assert "Req. WP was unexpected" in texts(station)


def test_mission_fence_and_rally_points_are_stored_and_cleared_apart(station):
    fence = [item(5001, n, e, p=(4.0,)) for n, e in ((5, 5), (5, -5), (-5, -5), (-5, 5))] + [
        item(5004, 20, 20, p=(3.0,))
    ]
    assert (
        upload(station, SQUARE) == upload(station, fence, 1) == upload(station, [item(5100, 1, 1, 2)], 2) == 0
    )
    assert [(m.command, m.param1, m.frame) for m in download(station, 1)] == [(5001, 4.0, 5)] * 4 + [
        (5004, 3.0, 5)
    ]
    assert [(m.command, m.z) for m in download(station, 2)] == [(5100, 2.0)]
    station.send(0, mavlink.MAVLink_mission_clear_all_message(1, 1, 1))
    assert [len(download(station, kind)) for kind in (0, 1, 2)] == [len(SQUARE), 0, 1]


def test_current_item_is_sent_every_second_and_set_within_the_list(station):
    upload(station, SQUARE)
    station.send(0, mavlink.MAVLink_mission_set_current_message(1, 1, 1))
    station.run(1.1)
    station.received.forget(0)
    station.run(3.0)
    told = messages(station, "MISSION_CURRENT")
    assert 3 <= len(told) <= 4 and {(m.seq, m.total) for m in told} == {(1, len(SQUARE))}
    station.send(0, mavlink.MAVLink_mission_set_current_message(1, 1, 9))
    station.run(0.04)
    assert "Not in list" in texts(station)


@pytest.mark.parametrize(
    ("items", "words"),
    [
        ([item(21)], "starts with landing"),
        ([waypoint(0, 0, 2), item(22, up=2)], "takeoff not first waypoint item"),
        ([item(22, up=-1.0)], "Takeoff altitude below home altitude!"),
        ([item(84, up=2)], "vehicle is not a VTOL"),
        ([waypoint(20_000, 0, 2)], "First waypoint far away from home: 20000m"),
        ([do(112, 3)], "item 1: unsupported cmd: 112"),
    ],
)
def test_infeasible_mission_is_stored_explained_and_not_started(station, items, words):
    assert upload(station, items) == 0
    assert words in texts(station)
    assert station.command(0, mavlink.MAV_CMD_MISSION_START) == 2
    station.run(0.04)
    assert "Mission start denied! No valid mission" in texts(station)
    assert not station.armed(0)


def test_messages_of_the_protocol_for_others_are_ignored(station):
    for system, component in ((0, 1), (7, 1), (1, 51)):
        station.send(0, mavlink.MAVLink_mission_count_message(system, component, 1, 0))
    station.run(0.04)
    assert not messages(station, "MISSION_REQUEST") and not messages(station, "MISSION_ACK")
    station.send(0, mavlink.MAVLink_mission_request_list_message(1, 190, 0))
    station.run(0.04)
    assert len(messages(station, "MISSION_COUNT")) == 1
