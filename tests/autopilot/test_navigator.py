"""Missions, returns and geofences, flown in the simulated world side by side."""

from __future__ import annotations

import math

import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from scenarios import LAT, LON, RADIUS_M, Lane, Scenarios, do, item, waypoint

TAKEOFF, LAND, RTL, DELAY, CHANGE_SPEED, JUMP = 22, 21, 20, 93, 178, 177
SMALL = {"NAV_ACC_RAD": 0.3, "NAV_MC_ALT_RAD": 0.3}

scenario = Scenarios()
lanes = scenario.fixture(origin=True)


def start(v: Lane, items, limit_s=12.0):
    """Upload and start a mission, and wait until the vehicle is in the air."""
    assert (yield from v.upload(items)) == 0
    assert (yield from v.command(mavlink.MAV_CMD_MISSION_START)) == 0
    assert v.armed and v.mode == "AUTO.MISSION"
    yield from v.until(lambda: v.position[2] < -0.6, limit_s)


def reached(v: Lane) -> list[int]:
    """Return the reached items in order, without repetitions."""
    found: list[int] = []
    for m in v.messages("MISSION_ITEM_REACHED"):
        if m.seq not in found[-1:]:
            found.append(m.seq)
    return found


def until_reached(v: Lane, seq, limit_s):
    return (yield from v.until(lambda: v.vehicle.missions.reached == seq, limit_s))


@scenario(**SMALL)
def test_mission_flies_waypoints_holds_turns_and_lands(v: Lane):
    yaw = 90.0
    yield from start(
        v,
        [item(TAKEOFF, up=1.5), waypoint(2, 0, 1.5), waypoint(2, 2, 2.0, 2.0, 0.3, yaw), item(LAND, 1, 2)],
    )
    assert "Executing Mission" in v.texts() and "Climb to 1.5 meters above home" in v.texts()
    yield from until_reached(v, 1, 15)
    assert v.away([2, 0, -1.55]) < 0.5
    yield from v.until(lambda: v.away([2, 2, -2.05]) < 0.2, 15)
    took = yield from until_reached(v, 2, 8)
    assert took > 1.0, "it holds for two seconds"
    q = v.flight.world.truth().q_nb[v.i]
    assert abs(math.degrees(2 * math.atan2(q[3], q[0])) - yaw) < 12.0
    yield from v.until(lambda: not v.armed, 25)
    assert v.away_level(1, 2) < 0.3
    assert "Mission finished, landed" in v.texts()
    assert reached(v) == [0, 1, 2, 3]


@scenario(**SMALL)
def test_path_to_a_waypoint_is_straight_and_at_the_set_speed(v: Lane):
    yield from start(
        v,
        [
            item(TAKEOFF, up=1.5),
            do(CHANGE_SPEED, 1, 1.0, -1),
            waypoint(5, 0, 1.5),
            waypoint(5, 0, 1.5, 60.0),
        ],
    )
    speeds, lateral = [], []

    def watch() -> None:
        speeds.append(float(np.hypot(*v.v_n[:2])))
        lateral.append(abs(float(v.position[1])))

    yield from until_reached(v, 0, 10)
    yield from v.until(lambda: v.vehicle.missions.reached == 2, 40, watch)
    assert 0.8 < max(speeds) < 1.25 and max(lateral) < 0.15


@scenario(**SMALL)
def test_jumps_delays_and_rtl_items_are_run_in_order(v: Lane):
    yield from start(
        v,
        [
            item(TAKEOFF, up=1.2),
            waypoint(1, 0, 1.2),
            waypoint(-1, 0, 1.2),
            do(JUMP, 1, 1),
            do(DELAY, 1.0),
            do(RTL),
        ],
    )
    yield from v.until(lambda: v.mode == "AUTO.RTL", 40)
    assert reached(v) == [0, 1, 2, 1, 2, 4]
    yield from v.until(lambda: not v.armed, 30)
    assert v.away_level() < 0.4
    assert "RTL: start return at" in v.texts() and "RTL: land at destination" in v.texts()


@scenario(**SMALL)
def test_paused_mission_continues_with_its_item(v: Lane):
    items = [item(TAKEOFF, up=1.5), do(CHANGE_SPEED, 1, 1.0, -1), waypoint(4, 0, 1.5), waypoint(4, 2, 1.5)]
    yield from start(v, items)
    yield from v.until(lambda: v.position[0] > 1.0, 20)
    assert (yield from v.set_mode(4, 3)) == 0
    yield from v.run(3.0)
    held = v.position.copy()
    yield from v.run(2.0)
    assert v.away(held) < 0.2 and held[0] < 3.0
    assert (yield from v.set_mode(4, 4)) == 0
    yield from v.until(lambda: "Mission finished, loitering" in v.texts(), 20)
    assert v.mode == "AUTO.MISSION" and v.armed
    assert v.away([4, 2, -1.55]) < 0.6


@scenario(**SMALL)
def test_mission_cleared_in_flight_holds_position(v: Lane):
    yield from start(v, [item(TAKEOFF, up=1.5), waypoint(10, 0, 1.5), item(LAND)])
    yield from v.until(lambda: v.position[0] > 1.0, 20)
    v.send(mavlink.MAVLink_mission_clear_all_message(v.i + 1, 1, 0))
    yield from v.run(8.0)
    held = v.position.copy()
    assert "No valid mission available, loitering" in v.texts() and held[0] < 6.0
    yield from v.run(2.0)
    assert v.away(held) < 0.3 and v.armed


def reposition(v: Lane, north: float, east: float, up: float):
    lat = LAT + math.degrees((v.start[0] + north) / RADIUS_M)
    lon = LON + math.degrees((v.start[1] + east) / (RADIUS_M * math.cos(math.radians(LAT))))
    alt = 100.0 - float(v.vehicle.home_n[2]) + up
    v.send(
        mavlink.MAVLink_command_int_message(
            v.i + 1, 1, 0, 192, 0, 0, -1.0, 1.0, 0, math.nan, round(lat * 1e7), round(lon * 1e7), alt
        )
    )
    yield from v.run(0.1)


@scenario(MIS_TAKEOFF_ALT=1.5)
def test_return_climbs_within_its_cone_flies_home_and_lands(v: Lane):
    assert (yield from v.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, math.nan)) == 0
    assert (yield from v.arm()) == 0
    yield from v.until(lambda: v.mode == "AUTO.LOITER", 15)
    yield from reposition(v, 4.0, 3.0, 1.5)
    yield from v.until(lambda: v.away([4, 3, -1.55]) < 0.3, 20)
    assert v.mode == "AUTO.LOITER"
    assert (yield from v.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)) == 0
    yield from v.until(lambda: v.position[2] < -4.0, 15)
    assert v.away_level(4, 3) < 0.6, "climb first: five metres from home, by the cone of 45 degrees"
    yield from v.until(lambda: not v.armed, 40)
    assert v.away_level() < 0.3


@scenario(MPC_LAND_ALT1=3.0, MPC_LAND_ALT2=1.5, MPC_LAND_SPEED=0.6, RTL_RETURN_ALT=4.0, RTL_CONE_ANG=0)
def test_return_slows_down_between_the_landing_heights(v: Lane):
    fast, slow = [], []

    def note() -> None:
        up = -v.position[2]
        (fast if 3.1 < up < 3.7 else slow if 0.5 < up < 1.2 else []).append(float(v.v_n[2]))

    yield from v.take_off_offboard(4.0)
    yield from v.run(4.0, v.holding([0, 0, -4.5]))
    assert (yield from v.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)) == 0
    yield from v.until(lambda: not v.armed, 30, note)
    assert max(fast) > 1.3 and 0.5 < sum(slow) / len(slow) < 0.75


@scenario(COM_OBL_RC_ACT=3, RTL_RETURN_ALT=2.0)
def test_lost_setpoints_return_home_if_configured(v: Lane):
    yield from v.take_off_offboard(1.5)
    yield from v.run(5.0, v.holding([2, 0, -1.5]))
    took = yield from v.until(lambda: v.mode != "OFFBOARD", 3)
    assert 0.9 < took < 1.15 and v.mode == "AUTO.RTL"
    yield from v.until(lambda: not v.armed, 30)
    assert v.away_level() < 0.3


FENCE = [item(5001, n, e, p=(4.0,)) for n, e in ((2, 2), (2, -2), (-2, -2), (-2, 2))]


def leave_fence(action: int, mode: str):
    def fly(v: Lane):
        assert (yield from v.upload(FENCE, 1)) == 0
        yield from v.take_off_offboard(1.5)
        assert v.mode == "OFFBOARD"
        out = v.holding([3, 0, -1.5])
        yield from v.until(lambda: v.position[0] > 2.05, 12, out)
        yield from v.run(0.3, out)
        assert v.mode == mode
        assert ("Geofence: approaching or outside geofence" in v.texts()) is (action > 0)

    return scenario.add(f"test_breach_of_the_fence_with_gf_action_{action}", fly, GF_ACTION=action)


test_breach_of_the_fence_with_gf_action_0 = leave_fence(0, "OFFBOARD")
test_breach_of_the_fence_with_gf_action_1 = leave_fence(1, "OFFBOARD")
test_breach_of_the_fence_with_gf_action_2 = leave_fence(2, "AUTO.LOITER")
test_breach_of_the_fence_with_gf_action_3 = leave_fence(3, "AUTO.RTL")
test_breach_of_the_fence_with_gf_action_5 = leave_fence(5, "AUTO.LAND")


@scenario(GF_MAX_VER_DIST=1.2, GF_MAX_HOR_DIST=5.0)
def test_height_and_distance_from_home_are_fences(v: Lane):
    up = v.holding([0, 0, -2.0])
    yield from v.run(0.3, up)
    assert (yield from v.set_mode(6)) == 0 and (yield from v.arm()) == 0
    yield from v.until(lambda: v.mode == "AUTO.LOITER", 12, up)
    assert "exceeding maximum altitude above Home" in v.texts()
    yield from v.run(1.0)
    assert v.position[2] > -1.9


@scenario
def test_invalid_fence_is_dropped_and_violating_mission_rejected(v: Lane):
    assert (yield from v.upload([item(5003, 20, 20, p=(3.0,))], 1)) == 0
    assert "Geofence invalid, doesn't contain Home position" in v.texts()
    assert (yield from v.upload(FENCE, 1)) == 0
    assert (yield from v.upload([item(TAKEOFF, up=1), waypoint(3, 0, 1)])) == 0
    assert "Geofence violation for waypoint 2" in v.texts()
    assert (yield from v.command(mavlink.MAV_CMD_MISSION_START)) == 2
