"""Missions, returns and fences flown in the simulated world, in one process."""

from __future__ import annotations

import math

import numpy as np
import pytest
from planned import do, item, ready, said, texts, upload, waypoint
from pymavlink.dialects.v20 import common as mavlink

TAKEOFF, LAND, RTL, DELAY = 22, 21, 20, 93
SMALL = {"NAV_ACC_RAD": 0.3, "NAV_MC_ALT_RAD": 0.3}


def start(flight, items, limit_s=12.0):
    """Upload, start, and come into the air."""
    assert upload(flight, items) == 0
    assert flight.command(0, mavlink.MAV_CMD_MISSION_START) == 0
    assert flight.armed(0) and flight.mode(0) == "AUTO.MISSION"
    flight.until(lambda f: f.position(0)[2] < -0.6, limit_s)


def reached(flight) -> list[int]:
    """Items in the order they were reached, without the repetitions."""
    found: list[int] = []
    for m in said(flight, "MISSION_ITEM_REACHED"):
        if m.seq not in found[-1:]:
            found.append(m.seq)
    return found


def until_reached(flight, seq, limit_s):
    return flight.until(lambda f: f.pilots.vehicles[0].missions.reached == seq, limit_s)


def test_a_mission_takes_off_flies_its_waypoints_holds_turns_and_lands_where_it_says():
    flight = ready(params=SMALL)
    yaw = 90.0
    start(
        flight,
        [item(TAKEOFF, up=1.5), waypoint(3, 0, 1.5), waypoint(3, 3, 2.0, 2.0, 0.3, yaw), item(LAND, 1, 3)],
    )
    assert "Executing Mission" in texts(flight) and "Climb to 1.5 meters above home" in texts(flight)
    until_reached(flight, 1, 15)
    assert np.linalg.norm(flight.position(0) - [3, 0, -1.55]) < 0.5
    flight.until(lambda f: np.linalg.norm(f.position(0) - [3, 3, -2.05]) < 0.2, 15)
    took = until_reached(flight, 2, 8)
    assert took > 1.0, "it holds for two seconds"
    q = flight.world.truth().q_nb[0]
    assert abs(math.degrees(2 * math.atan2(q[3], q[0])) - yaw) < 12.0
    flight.until(lambda f: not f.armed(0), 25)
    assert np.hypot(*(flight.position(0)[:2] - [1, 3])) < 0.3
    assert "Mission finished, landed" in texts(flight)
    assert reached(flight) == [0, 1, 2, 3]


def test_a_way_is_flown_no_faster_than_told_and_straight():
    flight = ready(params=SMALL)
    start(
        flight, [item(TAKEOFF, up=1.5), do(178, 1, 1.0, -1), waypoint(6, 0, 1.5), waypoint(6, 0, 1.5, 60.0)]
    )
    fastest, aside = 0.0, 0.0
    until_reached(flight, 0, 10)
    while flight.pilots.vehicles[0].missions.reached < 2:
        flight.run(0.1)
        assert flight.now < 60
        fastest = max(fastest, float(np.hypot(*flight.world.truth().v_n[0][:2])))
        aside = max(aside, abs(float(flight.position(0)[1])))
    assert 0.8 < fastest < 1.25 and aside < 0.15


def test_jumps_delays_and_the_mode_s_end_are_px4s():
    flight = ready(params=SMALL)
    start(
        flight,
        [
            item(TAKEOFF, up=1.2),
            waypoint(1, 0, 1.2),
            waypoint(-1, 0, 1.2),
            do(177, 1, 1),
            do(DELAY, 1.0),
            do(RTL),
        ],
    )
    flight.until(lambda f: f.mode(0) == "AUTO.RTL", 40)
    assert reached(flight) == [0, 1, 2, 1, 2, 4]
    flight.until(lambda f: not f.armed(0), 30)
    assert np.hypot(*flight.position(0)[:2]) < 0.4
    assert "RTL: start return at" in texts(flight) and "RTL: land at destination" in texts(flight)


def test_a_mission_is_paused_by_hold_and_goes_on_with_the_item_it_was_at():
    flight = ready(params=SMALL)
    start(flight, [item(TAKEOFF, up=1.5), do(178, 1, 1.0, -1), waypoint(4, 0, 1.5), waypoint(4, 2, 1.5)])
    flight.until(lambda f: f.position(0)[0] > 1.0, 20)
    assert flight.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == 0
    flight.run(3.0)
    held = flight.position(0).copy()
    flight.run(2.0)
    assert np.linalg.norm(flight.position(0) - held) < 0.2 and held[0] < 3.0
    assert flight.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 4) == 0
    flight.until(lambda f: "Mission finished, loitering" in texts(f), 20)
    assert flight.mode(0) == "AUTO.MISSION" and flight.armed(0)
    assert np.linalg.norm(flight.position(0) - [4, 2, -1.55]) < 0.6


def test_a_mission_cleared_in_flight_holds_where_it_is():
    flight = ready(params=SMALL)
    start(flight, [item(TAKEOFF, up=1.5), waypoint(10, 0, 1.5), item(LAND)])
    flight.until(lambda f: f.position(0)[0] > 1.0, 20)
    flight.send(0, mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    flight.run(8.0)
    held = flight.position(0).copy()
    assert "No valid mission available, loitering" in texts(flight) and held[0] < 6.0
    flight.run(2.0)
    assert np.linalg.norm(flight.position(0) - held) < 0.3 and flight.armed(0)


def hovering(flight, height=1.5):
    """In AUTO.LOITER, up there."""
    flight.pilots.params.set(0, "MIS_TAKEOFF_ALT", height)
    assert flight.command(0, mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, math.nan) == 0
    assert flight.arm(0) == 0
    flight.until(lambda f: f.mode(0) == "AUTO.LOITER", 15)


def goto(flight, north, east, up):
    lat = 38.7 + math.degrees(north / 6_371_000.0)
    lon = -9.1 + math.degrees(east / (6_371_000.0 * math.cos(math.radians(38.7))))
    home_alt = 100.0 - float(flight.pilots.vehicles[0].home_n[2])
    m = mavlink.MAVLink_command_int_message(
        1, 1, 0, 192, 0, 0, -1.0, 1.0, 0, math.nan, round(lat * 1e7), round(lon * 1e7), home_alt + up
    )
    flight.send(0, m)
    flight.run(0.1)


def test_the_return_climbs_within_its_cone_flies_home_and_lands():
    flight = ready()
    hovering(flight)
    goto(flight, 4.0, 3.0, 1.5)
    flight.until(lambda f: np.linalg.norm(f.position(0) - [4, 3, -1.55]) < 0.3, 20)
    assert flight.mode(0) == "AUTO.LOITER"
    assert flight.command(0, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == 0
    flight.until(lambda f: f.position(0)[2] < -4.0, 15)
    assert np.hypot(*(flight.position(0)[:2] - [4, 3])) < 0.6, (
        "up first: five metres from home, by the cone of 45 degrees"
    )
    flight.until(lambda f: not f.armed(0), 40)
    assert np.hypot(*flight.position(0)[:2]) < 0.3


def test_a_return_is_the_answer_to_lost_setpoints_where_it_is_asked_for():
    flight = ready(params={"COM_OBL_RC_ACT": 3, "RTL_RETURN_ALT": 2.0})
    flight.run(0.3, lambda f: f.setpoint(0, [0, 0, -1.5]))
    assert flight.offboard(0) == 0 and flight.arm(0) == 0
    flight.until(lambda f: f.position(0)[2] < -1.3, 12, lambda f: f.setpoint(0, [0, 0, -1.5]))
    flight.run(5.0, lambda f: f.setpoint(0, [2, 0, -1.5]))
    took = flight.until(lambda f: f.mode(0) != "OFFBOARD", 3)
    assert 0.9 < took < 1.15 and flight.mode(0) == "AUTO.RTL"
    flight.until(lambda f: not f.armed(0), 30)
    assert np.hypot(*flight.position(0)[:2]) < 0.3


FENCE = [item(5001, n, e, p=(4.0,)) for n, e in ((2, 2), (2, -2), (-2, -2), (-2, 2))]


@pytest.mark.parametrize(
    ("action", "mode"),
    [(0, "OFFBOARD"), (1, "OFFBOARD"), (2, "AUTO.LOITER"), (3, "AUTO.RTL"), (5, "AUTO.LAND")],
)
def test_leaving_the_fence_is_met_as_its_parameter_says(action, mode):
    flight = ready(params={"GF_ACTION": action})
    assert upload(flight, FENCE, 1) == 0
    flight.run(0.3, lambda f: f.setpoint(0, [0, 0, -1.5]))
    assert flight.offboard(0) == 0 and flight.arm(0) == 0
    flight.until(lambda f: f.position(0)[2] < -1.3, 12, lambda f: f.setpoint(0, [0, 0, -1.5]))
    assert flight.mode(0) == "OFFBOARD"
    flight.until(lambda f: f.position(0)[0] > 2.05, 12, lambda f: f.setpoint(0, [3, 0, -1.5]))
    flight.run(0.3, lambda f: f.setpoint(0, [3, 0, -1.5]))
    assert flight.mode(0) == mode
    assert ("Geofence: approaching or outside geofence" in texts(flight)) is (action > 0)


def test_height_and_distance_from_home_are_fences_and_outside_one_cannot_arm():
    flight = ready(params={"GF_MAX_VER_DIST": 1.2, "GF_MAX_HOR_DIST": 5.0})
    flight.run(0.3, lambda f: f.setpoint(0, [0, 0, -2.0]))
    assert flight.offboard(0) == 0 and flight.arm(0) == 0
    flight.until(lambda f: f.mode(0) == "AUTO.LOITER", 12, lambda f: f.setpoint(0, [0, 0, -2.0]))
    assert "exceeding maximum altitude above Home" in texts(flight)
    flight.run(1.0)
    assert flight.position(0)[2] > -1.9


def test_a_fence_that_does_not_hold_home_is_dropped_and_a_mission_that_leaves_it_rejected():
    flight = ready()
    assert upload(flight, [item(5003, 20, 20, p=(3.0,))], 1) == 0
    assert "Geofence invalid, doesn't contain Home position" in texts(flight)
    assert upload(flight, FENCE, 1) == 0
    assert upload(flight, [item(TAKEOFF, up=1), waypoint(3, 0, 1)]) == 0
    assert "Geofence violation for waypoint 2" in texts(flight)
    assert flight.command(0, mavlink.MAV_CMD_MISSION_START) == 2
