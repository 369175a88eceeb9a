"""Landings without poses: the vehicle reports the landing, disarms and follows the poses that return (review fault 22).

A vehicle flies north at 10 m/s, loses its poses and hits the wall (30 m north). After the collision the estimated horizontal
velocity is wrong by several metres per second, and the estimated position leaves the room. The velocity is invalid, so PX4's land
detector does not use it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from flight import PROFILE
from pymavlink.dialects.v20 import common as mavlink
from scenarios import Lane, Scenarios, Wait

from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.estimation.land_detector import LandDetector
from arena.autopilot.param_table import Params
from arena.constants import GRAVITY_M_S2
from arena.geometry import yaw_from_quat

scenario = Scenarios()
lanes = scenario.fixture(origin=False)

GAP_S = 3.0
BEYOND_THE_WALL = 45.0  # setpoint [m north]
ON_FLOOR_M = 0.3  # height of the body origin; a vehicle that leans on the wall is at 0.27 m
LANDED_S = 15.0  # limit from the touchdown until the vehicle is disarmed; the collision spoils the vertical velocity too


def estimate_error(v: Lane) -> float:
    """Return the horizontal distance between the estimated and the true position [m]."""
    return float(np.hypot(*(v.flight.pilots.est.p_n[v.i] - v.flight.position(v.i))[:2]))


def speed_error(v: Lane) -> float:
    return float(np.hypot(*(v.flight.pilots.est.v_n[v.i] - v.v_n)[:2]))


def lose_poses_and_hit_the_wall(v: Lane, height: float) -> Wait:
    """Fly to the wall without poses; return 3 s later, when the vehicle is low and its estimate is wrong."""
    yield from v.take_off_offboard(height)
    fast = v.holding([BEYOND_THE_WALL, 0, -height])
    yield from v.until(lambda: v.position[0] > 16.0, 10, fast)
    v.flight.vision_on[v.i] = False
    yield from v.run(GAP_S, fast)
    assert estimate_error(v) > 1.0 and speed_error(v) > 1.5, "the collision did not spoil the estimate"


def lands_and_disarms(v: Lane, each: Callable[[], None] | None = None) -> Wait:
    yield from v.until(lambda: v.position[2] > -ON_FLOOR_M, 10, each)
    yield from v.until(lambda: not v.armed, LANDED_S, each)
    assert "Landing detected" in v.texts()
    assert v.vehicle.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
    assert v.position[2] > -ON_FLOOR_M


def displaced(p, q):
    return p + np.array([2.0, -1.0, 0.0]), q


def blind_landing(name: str, height: float, returns: Callable | None = None, *, back: bool = True, **params):
    def fly(v: Lane):
        yield from lose_poses_and_hit_the_wall(v, height)
        v.flight.vision_on[v.i] = back
        if returns:
            v.flight.faults[v.i] = returns
        yield from lands_and_disarms(v)
        if back:
            seen = (returns or (lambda p, q: (p, q)))(v.flight.position(v.i), None)[0]
            yield from v.until(lambda: np.linalg.norm(v.flight.pilots.est.p_n[v.i] - seen) < 0.05, 10)
        if (
            back and v.flight.world.bodies.r_nb[v.i, 2, 2] > 0.9
        ):  # a vehicle that leans on the wall may not arm
            yield from v.until(lambda: v.vehicle.ready_to_arm, 10)

    return scenario.add(name, fly, **params)


test_landing_without_poses_ends_disarmed = blind_landing(
    "test_landing_without_poses_ends_disarmed", 1.5, back=False
)
test_poses_return_at_the_true_place = blind_landing("test_poses_return_at_the_true_place", 1.5)
test_poses_return_displaced = blind_landing("test_poses_return_displaced", 1.5, displaced)
test_low_flight_without_poses_ends_disarmed = blind_landing(
    "test_low_flight_without_poses_ends_disarmed", 0.5, back=False
)
test_poses_return_late_with_a_long_timeout = blind_landing(
    "test_poses_return_late_with_a_long_timeout", 1.5, EKF2_NOAID_TOUT=5_000_000
)


@scenario
def test_repeated_land_commands_end_disarmed(v: Lane):
    yield from lose_poses_and_hit_the_wall(v, 1.5)
    count = 0

    def land_twice_a_second() -> None:
        nonlocal count
        count += 1
        if count % 25 == 0:
            v.send(mavlink.MAVLink_command_long_message(v.i + 1, 1, mavlink.MAV_CMD_NAV_LAND, 0, *[0.0] * 7))

    yield from lands_and_disarms(v, land_twice_a_second)


@scenario(COM_DISARM_LAND=-1.0)
def test_armed_vehicle_on_the_floor_follows_the_poses_that_return(v: Lane):
    yield from lose_poses_and_hit_the_wall(v, 1.5)
    yield from v.until(lambda: v.flight.pilots.land.landed[v.i], 20)
    assert v.armed and estimate_error(v) > 1.0
    v.flight.faults[v.i] = displaced
    v.flight.vision_on[v.i] = True
    yield from v.until(lambda: v.vehicle.inputs.position_ok, 5)
    assert v.armed
    assert np.linalg.norm(v.flight.pilots.est.p_n[v.i] - displaced(v.flight.position(v.i), None)[0]) < 0.05
    place = v.position
    hover = v.holding([*displaced(place, None)[0][:2], -1.2])
    yield from v.run(0.5, hover)
    assert (yield from v.set_mode(6)) == 0
    yield from v.run(8.0, hover)
    assert v.mode == "OFFBOARD"
    assert v.away([*place[:2], -1.2]) < 0.15


def watch_the_air(v: Lane, each: Callable[[], None] | None = None) -> Callable[[], None]:
    """Return a function for each step of a flight; it fails if a vehicle in the air is detected as landed."""

    def look() -> None:
        if each:
            each()
        land, height = v.flight.pilots.land, -float(v.position[2])
        assert height < 0.15 or not (land.landed[v.i] or land.at_rest[v.i]), f"landed at {height:.2f} m"

    return look


def descends_blindly(name: str, target: list[float], wait_s: float, **params: float):
    def fly(v: Lane) -> Wait:
        yield from v.take_off_offboard(6.0)
        there = v.holding(target)
        yield from v.run(wait_s, there)
        v.flight.vision_on[v.i] = False
        yield from v.until(lambda: not v.armed, 40, watch_the_air(v, there))
        assert v.vehicle.commander.took_off is False and v.position[2] > -0.1

    return scenario.add(name, fly, MPC_LAND_SPEED=0.6, **params)


test_slow_blind_descent_is_not_landed = descends_blindly(
    "test_slow_blind_descent_is_not_landed", [0, 0, -6], 1.0
)
test_blind_descent_from_fast_flight_is_not_landed = descends_blindly(
    "test_blind_descent_from_fast_flight_is_not_landed", [-40, 0, -6], 1.5
)
test_blind_descent_from_a_climb_is_not_landed = descends_blindly(
    "test_blind_descent_from_a_climb_is_not_landed", [0, 0, -20], 1.0
)


@scenario
def test_hover_with_invalid_velocity_is_not_landed(v: Lane):
    yield from v.take_off_offboard(3.0)
    hover_thrust = float(v.flight.pilots.params["MPC_THR_HOVER"][v.i])

    def level() -> None:
        """Send a level attitude and the thrust that holds 3 m, from the true height."""
        thrust = hover_thrust + 0.1 * float(v.position[2] + 3.0) + 0.1 * float(v.v_n[2])
        v.send(
            mavlink.MAVLink_set_attitude_target_message(
                0, v.i + 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, thrust
            )
        )

    yield from v.run(0.5, level)
    v.flight.vision_on[v.i] = False
    yield from v.run(2.0, level)
    yield from v.run(15.0, watch_the_air(v, level))
    assert v.armed and not v.vehicle.inputs.xy_valid and abs(v.position[2] + 3.0) < 1.0


@scenario
def test_rejected_poses_are_not_followed_in_a_blind_descent(v: Lane):
    stream = yield from v.take_off_offboard(5.0)
    v.flight.faults[v.i] = displaced
    resets = int(v.flight.pilots.est.reset_counter[v.i])

    def look() -> None:
        stream()
        assert v.position[2] > -0.15 or v.flight.pilots.est.reset_counter[v.i] == resets

    yield from v.until(lambda: not v.armed, 30, look)
    assert v.away_level() < 0.5


# -- the detector alone ------------------------------------------------------------------------------------------------

HOVER = float(PROFILE["params"].get("MPC_THR_HOVER", Params(1)["MPC_THR_HOVER"][0]))


def detect(
    *,
    v_n: Any,
    thrust: float,
    sink: float = math.nan,
    valid: bool = False,
    force: float = GRAVITY_M_S2,
    rate: float = 0.0,
    climbing: bool = False,
    seconds: float = 5.0,
) -> LandDetector:
    """Return a detector of a flying vehicle after some seconds with one estimate and one thrust."""
    params = Params(1)
    est, detector = Estimator(params, 1, 0.004), LandDetector(params, 1)
    detector.landed[:] = False
    est.v_n[0], est.omega_b[0] = v_n, (rate, 0.0, 0.0)
    est._accel_mean[0] = 0.0, 0.0, -force
    est.xy_valid = lambda _: np.array([valid])  # type: ignore[method-assign]
    for k in range(round(seconds * 50)):
        detector.update(0.02 * k, est, np.array([thrust]), np.array([climbing]), np.array([sink]))
    return detector


LOW = 0.12  # MPC_THR_MIN


@pytest.mark.parametrize(
    ("state", "landed"),
    [
        ({"v_n": (7.0, 0.0, 0.1), "thrust": LOW, "sink": 0.7}, True),  # 22: on the floor after a collision
        ({"v_n": (7.0, 0.0, 0.1), "thrust": LOW, "sink": 0.7, "valid": True}, False),
        ({"v_n": (0.0, 0.0, 0.1), "thrust": LOW, "sink": 0.7, "valid": True}, True),
        ({"v_n": (7.0, 0.0, 0.7), "thrust": HOVER, "sink": 0.7}, False),  # blind descent
        ({"v_n": (0.0, 0.0, 0.3), "thrust": LOW, "sink": 0.6}, False),  # slow descent
        ({"v_n": (0.0, 0.0, 0.0), "thrust": HOVER}, False),  # hover
        ({"v_n": (0.0, 0.0, 0.0), "thrust": HOVER, "sink": 0.7}, False),
        ({"v_n": (0.0, 0.0, 0.0), "thrust": LOW, "sink": 0.7, "force": 0.5}, False),  # falls
        ({"v_n": (0.0, 0.0, 0.0), "thrust": LOW, "sink": 0.7, "rate": 1.0}, False),  # turns
        ({"v_n": (0.0, 0.0, 0.0), "thrust": LOW, "climbing": True}, False),
    ],
)
def test_landing_is_detected_only_on_the_ground(state, landed):
    detector = detect(**state)
    assert bool(detector.landed[0]) is landed
    assert bool(detector.at_rest[0]) is landed


def test_landing_takes_the_trigger_time():
    floor = {"v_n": (7.0, 0.0, 0.1), "thrust": LOW, "sink": 0.7}
    assert not detect(**floor, seconds=0.9).landed[0]
    assert detect(**floor, seconds=1.2).landed[0]
    assert not detect(**floor, seconds=1.9).at_rest[0]


# -- the estimator alone -----------------------------------------------------------------------------------------------


def standing(params: Params | None = None) -> tuple[Estimator, Callable[[float, float, bool], float]]:
    """Return an estimator after 3 s on the ground, and a function that continues: (seconds, north, poses) -> time."""
    params = params or Params(1)
    params.set(0, "EKF2_EV_CTRL", 15)
    est = Estimator(params, 1, 0.004)
    steps = 0

    def go_on(seconds: float, north: float, poses: bool = True, yaw: float = 0.0) -> float:
        nonlocal steps
        q = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
        for _ in range(round(seconds / 0.004)):
            est.predict(np.array([[0.0, 0.0, -GRAVITY_M_S2]]), np.zeros((1, 3)))
            if poses and steps % 4 == 0:
                est.vision_input.receive(0, (north, 0.0, 0.0), q, (1e-6,) * 3, 1e-6)
                est.fuse_vision(0.004 * steps)
            steps += 1
        return 0.004 * steps

    go_on(3.0, 0.0)
    return est, go_on


@pytest.mark.parametrize("at_rest", [False, True])
def test_displaced_poses_are_followed_only_at_rest(at_rest):
    est, go_on = standing()
    est.at_rest[:] = at_rest
    go_on(4.0, 2.0)
    assert est.reset_counter[0] == 0, "within EKF2_NOAID_TOUT of rejected poses, 5 s"
    now = go_on(3.0, 2.0)
    assert est.reset_counter[0] == at_rest
    assert bool(est.xy_valid(now)[0]) is at_rest
    assert abs(est.p_n[0, 0] - 2.0 * at_rest) < 0.05


def test_turned_poses_are_followed_at_rest():
    est, go_on = standing()
    est.at_rest[:] = True
    now = go_on(8.0, 0.0, True, math.pi)
    assert est.reset_counter[0] == 1
    assert est.xy_valid(now)[0] and est.yaw_valid(now)[0]
    assert abs(abs(float(yaw_from_quat(est.q_nb[0]))) - math.pi) < 0.05


def test_one_accepted_pose_restarts_the_time_of_rejection():
    est, go_on = standing()
    est.at_rest[:] = True
    for _ in range(4):
        go_on(3.0, 2.0)
        go_on(0.1, 0.0)
    assert est.reset_counter[0] == 0
