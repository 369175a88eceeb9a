"""What a ground station does with missions, for flights in one process: upload, download, and what comes of it."""

from __future__ import annotations

import math
from typing import Any

from flight import Flight
from pymavlink.dialects.v20 import common as mavlink

LAT, LON, ALT = 38.7, -9.1, 100.0
RADIUS_M = 6_371_000.0
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def ready(**settings: Any) -> Flight:
    """A flight that may be armed, with an origin, heard by a ground station."""
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


def lat_lon(north: float, east: float) -> tuple[int, int]:
    lat = LAT + math.degrees(north / RADIUS_M)
    lon = LON + math.degrees(east / (RADIUS_M * math.cos(math.radians(LAT))))
    return round(lat * 1e7), round(lon * 1e7)


def item(
    command: int,
    north: float = 0.0,
    east: float = 0.0,
    up: float = 0.0,
    p: tuple[float, ...] = (),
    **more: Any,
) -> dict:
    """An item at a place above home. p: its first parameters; the heading is free where it is not given."""
    x, y = lat_lon(north, east)
    params = (*p, *(0.0, 0.0, 0.0, math.nan)[len(p) :])
    return {"frame": RELATIVE, "command": command, "params": params, "x": x, "y": y, "z": up, **more}


def do(command: int, *p: float) -> dict:
    """An item without a place."""
    params = (*p, *(0.0,) * 4)[:4]
    return {
        "frame": mavlink.MAV_FRAME_MISSION,
        "command": command,
        "params": params,
        "x": 0,
        "y": 0,
        "z": 0.0,
    }


def waypoint(
    north: float, east: float, up: float, hold: float = 0.0, within: float = 0.3, yaw: float = math.nan
) -> dict:
    return item(mavlink.MAV_CMD_NAV_WAYPOINT, north, east, up, (hold, within, 0.0, yaw))


def said(flight: Flight, kind: str) -> list[Any]:
    return [m for m in flight.heard[0] if m.get_type() == kind]


def texts(flight: Flight) -> str:
    """All that was said; a long text comes in pieces."""
    return "".join(m.text for m in said(flight, "STATUSTEXT"))


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
    """The result in MISSION_ACK, each request answered as it comes."""
    flight.heard[0].clear()
    flight.send(0, mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for _ in range(20 + 5 * len(items)):
        flight.run(0.02)
        heard, flight.heard[0] = flight.heard[0], []
        for m in heard:
            if m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                send_item(flight, m.seq, items[m.seq], kind)
            elif m.get_type() == "MISSION_ACK":
                flight.run(0.1)
                flight.heard[0] = heard + flight.heard[0]
                return int(m.type)
    raise AssertionError("the upload was never acknowledged")


def download(flight: Flight, kind: int = 0) -> list[Any]:
    """Every item, as MISSION_ITEM_INT."""
    flight.heard[0].clear()
    flight.send(0, mavlink.MAVLink_mission_request_list_message(1, 1, kind))
    flight.run(0.02)
    count = said(flight, "MISSION_COUNT")[-1].count
    for seq in range(count):
        flight.send(0, mavlink.MAVLink_mission_request_int_message(1, 1, seq, kind))
        flight.run(0.02)
    flight.send(0, mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
    found = said(flight, "MISSION_ITEM_INT")
    assert [m.seq for m in found] == list(range(count))
    return found
