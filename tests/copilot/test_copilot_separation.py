"""Who comes too close to whom, and who yields."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.copilot.fleet_state import FleetState
from arena.copilot.separation import SeparationResult, approach, separation

from .scene import moment

AT_M, AHEAD_S = 0.8, 3.0


def look(m: FleetState) -> SeparationResult:
    return separation(m, AT_M, AHEAD_S, [f"uav{i + 1}" for i in range(len(m.p_n))])


def head_on(gap: float, speed: float = 1.5, **more: Any) -> FleetState:
    half = gap / 2.0
    return moment([[-half, 0, -1], [half, 0, -1]], [[speed, 0, 0], [-speed, 0, 0]], **more)


def rows(found: SeparationResult) -> list[int]:
    return [b.row for b in found.broken]


def test_later_vehicle_yields_first() -> None:
    assert rows(look(head_on(9.0))) == [1]
    assert "yields to uav1" in look(head_on(9.0)).broken[0].why


def test_vehicles_beyond_the_prediction_time_are_ignored() -> None:
    assert look(head_on(10.0)).broken == ()


def test_other_vehicle_is_held_when_its_own_stop_requires_it() -> None:
    held = {"held": [False, True]}
    gaps = np.arange(8.0, 0.9, -0.05)
    first = next(g for g in gaps if 0 in rows(look(head_on(float(g), **held))))
    way = head_on(first).stop.way
    assert first - abs(way[0, 0]) - abs(way[1, 0]) >= AT_M  # there was room left for both stops
    assert first < 6.0  # and it was not held as soon as the yielder


def test_standing_vehicle_makes_the_other_stop_in_time() -> None:
    def at(gap: float) -> FleetState:
        return moment([[0, 0, -1], [gap, 0, -1]], [[1.5, 0, 0], [0, 0, 0]], held=[False, True])

    way = float(at(5.0).stop.way[0, 0])
    assert 0 not in rows(look(at(way + AT_M + 0.5)))
    assert 0 in rows(look(at(way + AT_M + 0.1)))


def test_earlier_vehicle_yields_when_the_later_may_not_be_commanded() -> None:
    assert rows(look(head_on(8.0, open=[True, False]))) == [0]
    assert rows(look(head_on(8.0, open=[False, False]))) == []


def test_vehicle_on_the_ground_is_an_obstacle_and_never_yields() -> None:
    m = moment(
        [[0, 0, -0.5], [2.0, 0, 0.0]], [[1.5, 0, 0], [0, 0, 0]], flying=[True, False], open=[True, False]
    )
    assert rows(look(m)) == [0]


def test_vehicles_on_the_ground_may_be_close() -> None:
    m = moment([[0, 0, 0], [0.4, 0, 0]], flying=[False, False], open=[False, False])
    assert look(m).broken == () and look(m).closest == float("inf")


def test_passing_and_parting_is_no_conflict() -> None:
    for p, v in (
        ([[-4, 0, -1], [4, 1.2, -1]], [[1.5, 0, 0], [-1.5, 0, 0]]),
        ([[-4, 0, -1], [4, 0, -2.2]], [[1.5, 0, 0], [-1.5, 0, 0]]),
        ([[-0.3, 0, -1], [0.3, 0, -1]], [[-1.0, 0, 0], [1.0, 0, 0]]),
    ):
        assert look(moment(p, v)).broken == ()


def test_vehicle_that_stops_at_its_target_is_not_held() -> None:
    goes = {"p": [[0, 0, -1], [4.0, 0, -1]], "v": [[1.2, 0, 0], [0, 0, 0]]}
    assert rows(look(moment(goes["p"], goes["v"]))) == [1]
    target = [[2.5, 0, -1], [4.0, 0, -1]]
    assert rows(look(moment(goes["p"], goes["v"], target=target, settled=[True, True]))) == []
    # a setpoint that runs ahead of its vehicle is no place to stop at
    assert rows(look(moment(goes["p"], goes["v"], target=target, settled=[False, False]))) == [1]


def test_too_fast_vehicle_is_predicted_where_it_can_stop() -> None:
    p, v = [[0, 0, -1], [3.2, 0, -1]], [[3.0, 0, 0], [0, 0, 0]]
    assert 1 in rows(look(moment(p, v, target=[[0.5, 0, -1], [3.2, 0, -1]], settled=[True, True])))


def test_common_target_is_found_early() -> None:
    m = moment([[-5, 0, -1], [5, 0, -1]], target=[[0, 0, -1], [0.2, 0, -1]], settled=[True, True])
    assert look(m).meeting == ((0, 1),) and look(m).broken == ()
    assert (
        look(
            moment([[-5, 0, -1], [5, 0, -1]], target=[[0, 0, -1], [1.2, 0, -1]], settled=[True, True])
        ).meeting
        == ()
    )


def test_present_violation_needs_more_than_a_hold() -> None:
    assert {b.enough for b in look(moment([[0, 0, -1], [0.5, 0, -1]])).broken} == {"land"}
    assert {b.enough for b in look(head_on(8.0)).broken} == {"hold"}


@given(
    st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)
)
def test_closest_approach_of_straight_paths_equals_the_formula(
    x: float, y: float, a: float, b: float, c: float, d: float
) -> None:
    times = np.arange(0.0, 3.01, 0.1)
    r, w = np.array([x, y, 0.0]), np.array([c - a, d - b, 0.0])
    one, other = times[:, None] * np.array([a, b, 0.0]), r + times[:, None] * np.array([c, d, 0.0])
    t = np.clip(-(r @ w) / max(w @ w, 1e-12), 0.0, 3.0)
    nearest, _ = approach(one[None], other[None], times)
    assert nearest[0] == pytest.approx(np.linalg.norm(r + t * w), abs=1e-6)


def test_only_conflicting_pairs_of_fifty_vehicles_are_found() -> None:
    n, e = np.meshgrid(np.arange(10) * 2.0, np.arange(5) * 2.0)
    p = np.column_stack([n.ravel(), e.ravel(), np.full(50, -1.0)])
    v = np.zeros((50, 3))
    v[7] = (0.0, 1.0, 0.0)
    began = time.thread_time()
    found = look(moment(p.tolist(), v.tolist()))
    print(f"{1e3 * (time.thread_time() - began):.2f} ms")
    assert rows(found) == [17]
