"""The stop: how far a vehicle goes on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.copilot.braking import DISTANCE_FACTOR, REACTION_S, SWING_S, predict_stops, stop

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
def test_formula_equals_the_integrated_stop(speed: float, accel: float, jerk: float) -> None:
    assert one(speed, accel, jerk)[0] == pytest.approx(brake(speed, accel, jerk), rel=0.01, abs=0.01)


def test_stop_from_3_m_s_takes_about_3_m() -> None:
    whole = predict_stops(
        np.zeros((1, 3)), np.array([[3.0, 0, 0]]), np.zeros((1, 3)), np.array([0.05]), limits(1)
    ).way
    assert 2.5 < whole[0, 0] < 4.0


@given(SPEEDS, SPEEDS, st.floats(1.0, 15.0), st.floats(1.0, 40.0))
def test_faster_vehicle_needs_no_shorter_distance(a: float, b: float, accel: float, jerk: float) -> None:
    slow, fast = sorted((a, b))
    assert one(slow, accel, jerk)[0] <= one(fast, accel, jerk)[0] + 1e-9


@given(SPEEDS, st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_acceleration_lengthens_the_stop_and_deceleration_never_shortens_it(
    speed: float, more: float, less: float
) -> None:
    v = np.array([[speed + 0.01, 0.0, 0.0]])
    way = [
        float(predict_stops(np.zeros((1, 3)), v, np.array([[a, 0.0, 0.0]]), np.zeros(1), limits(1)).way[0, 0])
        for a in (-less, 0, more)
    ]
    assert way[0] == way[1] <= way[2] + 1e-9


@given(st.floats(-6, 6), st.floats(-6, 6), st.floats(-3, 3), st.floats(0, 1), st.floats(0, 1))
def test_path_ends_at_the_stopping_distance_without_a_step_back(
    n: float, e: float, d: float, react_s: float, later_s: float
) -> None:
    v = np.array([[n, e, d]])
    found = predict_stops(np.array([[1.0, 2.0, -1.0]]), v, np.zeros((1, 3)), np.array([react_s]), limits(1))
    path = found.path(np.arange(0.0, 20.0, 0.05), later_s)[0]
    assert np.allclose(path[0], found.start[0])
    assert np.allclose(path[-1], found.start[0] + found.way[0] + later_s * found.v_n[0], atol=1e-6)
    assert (np.diff((path - path[0]) @ v[0]) >= -1e-9).all()


def test_reaction_and_swing_are_flown_at_full_speed() -> None:
    v, lean = np.array([[2.0, 0.0, 0.0]]), np.array([[4.0, 0.0, 0.0]])
    steady = predict_stops(np.zeros((1, 3)), v, np.zeros((1, 3)), np.array([0.1]), limits(1))
    hurried = predict_stops(np.zeros((1, 3)), v, lean, np.array([0.1]), limits(1))
    assert steady.way[0, 0] == pytest.approx(2.0 * (0.1 + REACTION_S) + DISTANCE_FACTOR * one(2.0)[0])
    assert hurried.v_n[0, 0] == pytest.approx(2.0 + 4.0 * SWING_S)


def test_climb_and_descent_have_their_own_limits() -> None:
    up, down = (
        predict_stops(np.zeros((1, 3)), np.array([[0, 0, w]]), np.zeros((1, 3)), np.zeros(1), limits(1))
        for w in (-3.0, 3.0)
    )
    assert up.way[0, 2] < 0.0 < down.way[0, 2]
    assert abs(up.way[0, 2]) > down.way[0, 2]
