"""What each rule says of hand-made moments."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.copilot.fleet_state import Broken, Moment
from arena.copilot.rules import Judge

from .scene import moment, rules, vehicle

FAR = [0.0, 0.0, -1.0]


def judge(n: int = 1, **section: Any) -> Judge:
    return Judge(rules(**section), [vehicle(i + 1) for i in range(n)])


def named(found: list[Broken]) -> list[tuple[int, str]]:
    return [(b.row, b.rule) for b in found]


def test_a_healthy_hover_breaks_nothing() -> None:
    assert judge(2).broken(moment([FAR, [2.0, 0.0, -1.0]])) == []


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0, 3.0, 4.5])
@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (0, -1), (1, 1), (1, -1), (2, -1)])
def test_the_fence_is_broken_where_the_way_to_stop_and_the_reserve_would_pass_it(
    speed: float, axis: int, sign: int
) -> None:
    v = np.zeros(3)
    v[axis] = sign * speed
    way = abs(moment([FAR], [v.tolist()]).stop.way[0, axis])
    edge = 3.0 if axis == 2 else 6.0
    for spare, expected in ((0.21, []), (0.19, [(0, "geofence")])):
        p = np.array([0.0, 0.0, -1.0])
        p[axis] = sign * (edge - way - spare)
        assert named(judge().broken(moment([p.tolist()], [v.tolist()]))) == expected


def test_a_fast_vehicle_needs_more_room_than_a_slow_one() -> None:
    def least(speed: float) -> float:
        distances = np.arange(0.0, 6.0, 0.02)
        return min(
            d for d in distances if not judge().broken(moment([[6.0 - d, 0.0, -1.0]], [[speed, 0.0, 0.0]]))
        )

    found = [least(v) for v in (0.5, 1.0, 2.0, 3.0)]
    assert found == sorted(found) and found[-1] > found[0] + 2.0


def test_along_the_fence_and_away_from_it_nothing_is_broken_even_in_the_reserve() -> None:
    for v in ([0.0, 1.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 0.0, 0.0]):
        assert judge().broken(moment([[5.9, 0.0, -1.0]], [v])) == []


def test_past_the_fence_it_is_broken_unless_the_vehicle_comes_back() -> None:
    assert named(judge().broken(moment([[6.1, 0.0, -1.0]]))) == [(0, "geofence")]
    assert judge().broken(moment([[6.1, 0.0, -1.0]], [[-0.5, 0.0, 0.0]])) == []


def test_down_is_no_fence() -> None:
    assert judge().broken(moment([[0.0, 0.0, -0.3]], [[0.0, 0.0, 2.0]])) == []


def test_the_reason_tells_the_figures() -> None:
    (found,) = judge().broken(moment([[4.0, 0.0, -1.0]], [[3.0, 0.0, 0.0]]))
    assert "to stop from 3.0 m/s it needs" in found.why and "the north is 2.00 m away" in found.why


def test_tilt_counts_once_it_has_lasted() -> None:
    of = judge()
    leaning = moment([FAR], tilt=[np.radians(60.0)], now=10.0)
    assert of.broken(leaning) == []
    assert of.broken(replace(leaning, now=10.2)) == []
    assert named(of.broken(replace(leaning, now=10.31))) == [(0, "tilt")]
    assert of.broken(replace(leaning, now=10.4, tilt=np.zeros(1))) == []
    assert of.broken(replace(leaning, now=10.5)) == []  # it begins anew


@pytest.mark.parametrize(
    ("given_", "rule"),
    [
        ({"v_n": [[4.0, 3.1, 0.0]]}, "speed"),
        ({"pose_age": [0.6]}, "pose_age"),
        ({"pose_age": [np.inf], "placed": [False], "moving": [False]}, "pose_age"),
        ({"battery": [0.09]}, "battery"),
        ({"silent_s": [1.1]}, "program"),
    ],
)
def test_each_rule_has_its_limit(given_: dict[str, Any], rule: str) -> None:
    section = {"geofence": {"do": "none"}}
    assert named(judge(**section).broken(moment([FAR], **given_))) == [(0, rule)]
    assert judge(**section, **{rule: {"do": "none"}}).broken(moment([FAR], **given_)) == []


def test_an_estimate_that_is_off_counts_once_it_has_lasted() -> None:
    of = judge()
    off = moment([FAR], off=[0.35])
    assert of.broken(off) == []
    assert named(of.broken(replace(off, now=10.51))) == [(0, "estimate")]


@pytest.mark.parametrize(
    "unknown",
    [{"battery": [np.nan]}, {"silent_s": [np.nan]}, {"off": [np.nan]}, {"target": [[np.nan] * 3]}],
)
def test_what_is_not_known_is_not_judged(unknown: dict[str, Any]) -> None:
    assert judge().broken(moment([FAR], **unknown)) == []


def test_out_of_offboard_the_programs_silence_is_its_own_affair() -> None:
    assert judge().broken(moment([FAR], silent_s=[5.0], offboard=[False])) == []


def test_a_vehicle_that_is_not_placed_is_not_judged_by_its_place() -> None:
    lost = moment(
        [[9.0, 9.0, -9.0]], [[9.0, 0.0, 0.0]], placed=[False], moving=[False], tilt=[3.0], off=[9.0]
    )
    assert judge().broken(lost) == []


@given(st.data())
def test_nothing_is_ever_said_of_a_vehicle_that_does_not_fly(data: st.DataObject) -> None:
    numbers = st.floats(-20, 20) | st.just(float("nan"))
    rows = st.lists(st.lists(st.floats(-20, 20), min_size=3, max_size=3), min_size=3, max_size=3)
    each = st.lists(numbers, min_size=3, max_size=3)
    flags = st.lists(st.booleans(), min_size=3, max_size=3)
    made = moment(
        data.draw(rows),
        data.draw(rows),
        flying=data.draw(flags),
        open=data.draw(flags),
        held=data.draw(flags),
        placed=data.draw(flags),
        moving=data.draw(flags),
        battery=data.draw(each),
        off=data.draw(each),
        silent_s=data.draw(each),
        target=data.draw(rows),
        settled=data.draw(flags),
        pose_age=data.draw(st.lists(st.floats(0, 9), min_size=3, max_size=3)),
    )
    made = replace(made, open=made.open & made.flying)
    assert {f.name for f in fields(Moment)} >= {"flying"}
    of = judge(3)
    for later in (0.0, 1.0):
        assert all(made.flying[b.row] for b in of.broken(replace(made, now=10.0 + later)))
