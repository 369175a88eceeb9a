"""Global positions in an arena whose north axis is not true north (`world.heading_deg`)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink
from scenarios import ALT, LAT, LON, RADIUS_M, lat_lon

from arena.autopilot.flight_modes import Mode
from arena.autopilot.navigation.geofence import read_areas
from arena.autopilot.navigation.mission_items import Item, Origin, position_of
from arena.geometry import globe_from_local, local_from_globe

EAST = Origin(LAT, LON, ALT, math.radians(90.0))  # the arena's north is true east
UP_M = 1.5


def true_north_east(m) -> tuple[float, float]:
    """Return true north and east of a global position from the origin [m]."""
    north = math.radians(m.lat * 1e-7 - LAT) * RADIUS_M
    return north, math.radians(m.lon * 1e-7 - LON) * RADIUS_M * math.cos(math.radians(LAT))


def newest(flight: Flight, kind: str):
    return [m for m in flight.received[0] if m.get_type() == kind][-1]


@pytest.fixture(scope="module")
def flight() -> Flight:
    """A vehicle that hovers 3 m along the arena's north, which is true east."""
    flight = Flight(1, heading_deg=90.0)
    place = (round(LAT * 1e7), round(LON * 1e7), int(ALT * 1e3))
    flight.send(0, mavlink.MAVLink_set_gps_global_origin_message(1, *place, 0))
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    flight.run(0.3, lambda f: f.setpoint(0, [0, 0, -UP_M]))
    assert flight.offboard(0) == flight.arm(0) == 0
    flight.until(lambda f: f.position(0)[2] < -1.2, 12, lambda f: f.setpoint(0, [0, 0, -UP_M]))
    flight.run(6.0, lambda f: f.setpoint(0, [3, 0, -UP_M]))
    return flight


def test_reported_global_position_heading_and_home_are_turned(flight: Flight):
    m = newest(flight, "GLOBAL_POSITION_INT")
    assert true_north_east(m) == pytest.approx((0.0, 3.0), abs=0.15)
    assert m.hdg / 100.0 == pytest.approx(90.0, abs=3.0)
    assert newest(flight, "VFR_HUD").heading == pytest.approx(90.0, abs=3.0)
    flight.command(0, mavlink.MAV_CMD_DO_SET_HOME, 1)
    flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    home = newest(flight, "HOME_POSITION")
    assert (home.latitude * 1e-7 - LAT) * 1e5 == pytest.approx(0.0, abs=0.2)
    assert home.x == pytest.approx(3.0, abs=0.15)


def test_global_setpoint_is_flown_from_true_north(flight: Flight):
    lat, lon = lat_lon(-1.0, 2.0)  # true south 1 m, true east 2 m: arena north 2 m, arena east 1 m
    target = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 5, 0b100111111000, lat, lon, ALT + UP_M, 0, 0, 0, 0, 0, 0, math.radians(90.0), 0
    )
    flight.run(6.0, lambda f: f.send(0, target))
    assert flight.pilots.vehicles[0].commander.mode is Mode.OFFBOARD
    assert flight.position(0) == pytest.approx([2.0, 1.0, -UP_M], abs=0.15)
    assert flight.pilots.vehicles[0].yaw() == pytest.approx(0.0, abs=0.05)
    assert newest(flight, "GLOBAL_POSITION_INT").hdg / 100.0 == pytest.approx(90.0, abs=3.0)


def test_global_velocity_setpoint_is_turned(flight: Flight):
    north = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 5, 0b110111000111, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0
    )
    before = flight.position(0).copy()
    flight.run(2.0, lambda f: f.send(0, north))
    moved = flight.position(0) - before
    assert moved[1] < -0.4 and abs(moved[0]) < 0.2, "true north is the arena's west"
    assert newest(flight, "GLOBAL_POSITION_INT").vx > 20


def item(command: int, north: float, east: float, *params: float) -> Item:
    lat, lon = lat_lon(north, east)
    kept = (*params, 0.0, 0.0, 0.0, 0.0)[:4]
    frame = mavlink.MAV_FRAME_GLOBAL_INT
    return Item(frame=frame, command=command, params=kept, x=lat * 1e-7, y=lon * 1e-7, z=ALT + 2.0)


def test_mission_items_are_turned():
    found = position_of(item(mavlink.MAV_CMD_NAV_WAYPOINT, 2.0, 5.0), EAST, 0.0)
    assert found == pytest.approx((5.0, -2.0, -2.0), abs=0.02)


def test_fence_areas_are_turned():
    (area,) = read_areas([item(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, 2.0, 5.0, 1.0)], EAST)
    assert area.allows((5.0, -2.0)) and not area.allows((2.0, 5.0))


@pytest.mark.parametrize("heading_deg", [0.0, 35.0, -120.0])
def test_global_and_local_positions_are_inverse(heading_deg: float):
    heading = math.radians(heading_deg)
    there = globe_from_local(LAT, LON, 12.0, -7.0, heading)
    assert local_from_globe(LAT, LON, *there, heading) == pytest.approx((12.0, -7.0))
    assert np.hypot(*local_from_globe(LAT, LON, *there)) == pytest.approx(np.hypot(12.0, 7.0))
