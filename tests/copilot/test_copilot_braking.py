"""The stop: how far a vehicle goes on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.copilot.braking import LONGER, REACTION_S, SWING_S, stop, stops

from .scene import limits

SPEEDS = st.floats(0.0, 12.0)


def one(speed: float, accel: float = 3.0, jerk: float = 4.0) -> tuple[float, float]:
    way, took = stop(np.array([speed]), np.array([accel]), np.array([jerk]))
    return float(way[0]), float(took[0])


def brake(speed: float, accel: float, jerk: float, dt: float = 1e-4) -> float:
    """The same stop, stepped: the acceleration falls to -A, stays, and returns so that it is zero as the speed is."""
    v, a, way = speed, 0.0, 0.0
    while v > 1e-6:
        ends = v <= a * a / (2.0 * jerk) + 1e-9
        a = min(0.0, a + jerk * dt) if ends else max(-accel, a - jerk * dt)
        if ends and a == 0.0:
            break
        v += a * dt
        way += max(v, 0.0) * dt
    return way


@pytest.mark.parametrize("speed", [0.3, 1.0, 2.25, 3.0, 5.0])
@pytest.mark.parametrize(("accel", "jerk"), [(3.0, 4.0), (5.0, 8.0), (2.0, 20.0)])
def test_the_formula_is_the_way_of_a_stop_that_is_stepped(speed: float, accel: float, jerk: float) -> None:
    assert one(speed, accel, jerk)[0] == pytest.approx(brake(speed, accel, jerk), rel=0.01, abs=0.01)


def test_at_3_m_s_and_px4s_defaults_a_stop_takes_about_3_m() -> None:
    whole = stops(
        np.zeros((1, 3)), np.array([[3.0, 0, 0]]), np.zeros((1, 3)), np.array([0.05]), limits(1)
    ).way
    assert 2.5 < whole[0, 0] < 4.0


@given(SPEEDS, SPEEDS, st.floats(1.0, 15.0), st.floats(1.0, 40.0))
def test_a_faster_vehicle_never_stops_sooner(a: float, b: float, accel: float, jerk: float) -> None:
    slow, fast = sorted((a, b))
    assert one(slow, accel, jerk)[0] <= one(fast, accel, jerk)[0] + 1e-9


@given(SPEEDS, st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_speeding_up_makes_the_way_longer_and_slowing_down_never_shorter(
    speed: float, more: float, less: float
) -> None:
    v = np.array([[speed + 0.01, 0.0, 0.0]])
    way = [
        float(stops(np.zeros((1, 3)), v, np.array([[a, 0.0, 0.0]]), np.zeros(1), limits(1)).way[0, 0])
        for a in (-less, 0, more)
    ]
    assert way[0] == way[1] <= way[2] + 1e-9


@given(st.floats(-6, 6), st.floats(-6, 6), st.floats(-3, 3), st.floats(0, 1), st.floats(0, 1))
def test_the_path_leads_without_a_step_back_to_where_the_way_ends(
    n: float, e: float, d: float, react_s: float, later_s: float
) -> None:
    v = np.array([[n, e, d]])
    found = stops(np.array([[1.0, 2.0, -1.0]]), v, np.zeros((1, 3)), np.array([react_s]), limits(1))
    path = found.path(np.arange(0.0, 20.0, 0.05), later_s)[0]
    assert np.allclose(path[0], found.start[0])
    assert np.allclose(path[-1], found.start[0] + found.way[0] + later_s * found.v_n[0], atol=1e-6)
    assert (np.diff((path - path[0]) @ v[0]) >= -1e-9).all()


def test_the_reaction_and_the_swing_are_flown_at_speed() -> None:
    v, lean = np.array([[2.0, 0.0, 0.0]]), np.array([[4.0, 0.0, 0.0]])
    steady = stops(np.zeros((1, 3)), v, np.zeros((1, 3)), np.array([0.1]), limits(1))
    hurried = stops(np.zeros((1, 3)), v, lean, np.array([0.1]), limits(1))
    assert steady.way[0, 0] == pytest.approx(2.0 * (0.1 + REACTION_S) + LONGER * one(2.0)[0])
    assert hurried.v_n[0, 0] == pytest.approx(2.0 + 4.0 * SWING_S)


def test_a_climb_and_a_descent_are_braked_by_their_own_limits() -> None:
    up, down = (
        stops(np.zeros((1, 3)), np.array([[0, 0, w]]), np.zeros((1, 3)), np.zeros(1), limits(1))
        for w in (-3.0, 3.0)
    )
    assert up.way[0, 2] < 0.0 < down.way[0, 2]
    assert abs(up.way[0, 2]) > down.way[0, 2]
