"""Check of a trajectory before a flight."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from arena.errors import VehicleError
from arena.fly.feasibility import FlightLimits, limits_of, problems_of
from arena.fly.follow_file import check_way
from arena.live_view.settings import Fence, Settings, VehicleSettings
from arena.obstacles import Obstacle
from arena.trajectories import Circle, Sampled, SetpointList

LIMITS = FlightLimits(
    low=(-2.0, -2.0, -3.0), high=(2.0, 2.0, -0.1), where="room", speed=2.0, up=1.0, down=0.5, accel=3.0
)
VEHICLE = VehicleSettings(
    name="uav1", id=1, kind="simulated", autopilot="builtin", index=0, body="uav1", tools=("127.0.0.1", 1),
    profile="iris", radius_m=0.3, height_m=0.1, rotors=(),
)  # fmt: skip


def line(to, seconds, start=(0.0, 0.0, -1.0)):
    t = np.linspace(0.0, seconds, 20)
    way = np.asarray(to, float) - np.asarray(start)
    return Sampled(t, np.asarray(start) + np.outer(t / seconds, way))


def room(fence=None, ceiling=True):
    return Settings(
        size_m=(6.0, 4.0, 3.0), ceiling=ceiling, fence=fence, clock=None, truth=None, captures=(), vehicles=()
    )


@pytest.mark.parametrize(
    ("trajectory", "part"),
    [
        (line((2.5, 0.0, -1.0), 10.0), "north"),
        (line((0.0, -2.5, -1.0), 10.0), "east"),
        (line((0.0, 0.0, -3.5), 10.0), "down"),
        (line((0.0, 0.0, 0.2), 10.0), "down"),
        (line((1.9, 0.0, -1.0), 0.5), "horizontal speed"),
        (line((0.0, 0.0, -2.5), 1.0), "climb rate"),
        (line((0.0, 0.0, -0.2), 1.0), "sink rate"),
    ],
)
def test_every_violated_limit_is_named(trajectory, part):
    problems = problems_of(trajectory, LIMITS)
    assert len(problems) == 1 and part in problems[0], problems


def test_time_of_the_first_violation_is_named():
    (problem,) = problems_of(line((4.0, 0.0, -1.0), 10.0), LIMITS)
    assert "at 5.02 s" in problem or "at 5.04 s" in problem


def test_acceleration_above_the_limit_is_found():
    t = np.linspace(0.0, 4.0, 400)
    pos = np.stack([0.5 * np.cos(3.0 * t), 0.5 * np.sin(3.0 * t), np.full_like(t, -1.0)], axis=1)
    assert [p.split(" above")[0] for p in problems_of(Sampled(t, pos), LIMITS)] == ["acceleration"]


def test_setpoint_list_that_jumps_is_checked_for_its_places_only():
    jumps = SetpointList([((1.0, 1.0, -1.0), 0.0, 1.0), ((-1.0, -1.0, -2.0), 0.0, 1.0)])
    assert problems_of(jumps, LIMITS) == []
    outside = SetpointList([((1.0, 1.0, -1.0), 0.0, 1.0), ((-1.0, -3.0, -2.0), 0.0, 1.0)])
    assert len(problems_of(outside, LIMITS)) == 1


def test_feasible_circle_has_no_problem():
    assert problems_of(Circle((-1.0, 0.0, -1.2), 1.0, lap_s=8.0), LIMITS) == []


def test_limits_are_the_room_minus_the_vehicle():
    found = limits_of(room(), VEHICLE, (2.0, 1.0, 0.5, 3.0))
    assert found.where == "room"
    assert found.low == pytest.approx((-2.68, -1.68, -2.68)) and found.high[:2] == pytest.approx((2.68, 1.68))


def test_limits_are_the_geofence_if_there_is_one():
    fence = Fence(north=(-1.0, 2.0), east=(-0.5, 0.7), up=1.5)
    found = limits_of(room(fence), VEHICLE, (2.0, 1.0, 0.5, 3.0))
    assert (found.where, found.low, found.high[:2]) == ("geofence", (-1.0, -0.5, -1.5), (2.0, 0.7))


def test_room_without_a_ceiling_limits_no_height():
    assert limits_of(room(ceiling=False), VEHICLE, (2.0, 1.0, 0.5, 3.0)).low[2] == -np.inf


POLE = Obstacle(name="pole", shape="cylinder", size_m=(0.2, 0.2, 3.0), centre_n=(1.0, 0.0, -1.5))


def limits_with_pole() -> FlightLimits:
    return limits_of(dataclasses.replace(room(), obstacles=(POLE,)), VEHICLE, (2.0, 1.0, 0.5, 3.0))


@pytest.mark.parametrize(
    "trajectory",
    [
        line((2.0, 0.0, -1.0), 10.0),
        line((2.0, 0.35, -1.0), 10.0),
        SetpointList([((0.0, 0.0, -1.0), 0.0, 1.0), ((2.0, 0.0, -1.0), 0.0, 1.0)]),
    ],
    ids=["through", "beside, nearer than the radius", "between two setpoints"],
)
def test_trajectory_that_meets_an_obstacle_is_refused(trajectory):
    (problem,) = problems_of(trajectory, limits_with_pole())
    assert problem.startswith("too near to the obstacle pole at")


def test_trajectory_beside_an_obstacle_is_flown():
    assert problems_of(line((2.0, 0.6, -1.0), 10.0, start=(0.0, 0.6, -1.0)), limits_with_pole()) == []


def test_way_to_the_start_that_meets_an_obstacle_is_refused():
    check_way(np.array([[0.0, 1.0, -1.0], [2.0, 1.0, -1.0]]), limits_with_pole())
    with pytest.raises(VehicleError, match="start of the trajectory is too near to the obstacle pole: "):
        check_way(np.array([[0.0, 0.0, -1.0], [2.0, 0.0, -1.0]]), limits_with_pole())
