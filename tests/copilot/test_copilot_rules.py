"""What each rule says of hand-made moments."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.copilot.fleet_state import FleetState, Violation
from arena.copilot.rules import RuleChecker

from .scene import moment, rules, vehicle

FAR = [0.0, 0.0, -1.0]


def judge(n: int = 1, **section: Any) -> RuleChecker:
    return RuleChecker(rules(**section), [vehicle(i + 1) for i in range(n)])


def named(found: list[Violation]) -> list[tuple[int, str]]:
    return [(b.row, b.rule) for b in found]


def test_normal_hover_violates_nothing() -> None:
    assert judge(2).violations(moment([FAR, [2.0, 0.0, -1.0]])) == []


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0, 3.0, 4.5])
@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (0, -1), (1, 1), (1, -1), (2, -1)])
def test_fence_is_violated_when_stop_and_reserve_would_pass_it(speed: float, axis: int, sign: int) -> None:
    v = np.zeros(3)
    v[axis] = sign * speed
    way = abs(moment([FAR], [v.tolist()]).stop.way[0, axis])
    edge = 3.0 if axis == 2 else 6.0
    for spare, expected in ((0.21, []), (0.19, [(0, "geofence")])):
        p = np.array([0.0, 0.0, -1.0])
        p[axis] = sign * (edge - way - spare)
        assert named(judge().violations(moment([p.tolist()], [v.tolist()]))) == expected


def test_fast_vehicle_needs_more_room() -> None:
    def least(speed: float) -> float:
        distances = np.arange(0.0, 6.0, 0.02)
        return min(
            d
            for d in distances
            if not judge().violations(moment([[6.0 - d, 0.0, -1.0]], [[speed, 0.0, 0.0]]))
        )

    found = [least(v) for v in (0.5, 1.0, 2.0, 3.0)]
    assert found == sorted(found) and found[-1] > found[0] + 2.0


def test_flight_along_the_fence_is_no_violation() -> None:
    for v in ([0.0, 1.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 0.0, 0.0]):
        assert judge().violations(moment([[5.9, 0.0, -1.0]], [v])) == []


def test_vehicle_past_the_fence_violates_it_unless_it_returns() -> None:
    assert named(judge().violations(moment([[6.1, 0.0, -1.0]]))) == [(0, "geofence")]
    assert judge().violations(moment([[6.1, 0.0, -1.0]], [[-0.5, 0.0, 0.0]])) == []


def test_fence_has_no_lower_limit() -> None:
    assert judge().violations(moment([[0.0, 0.0, -0.3]], [[0.0, 0.0, 2.0]])) == []


def test_reason_has_the_values() -> None:
    (found,) = judge().violations(moment([[4.0, 0.0, -1.0]], [[3.0, 0.0, 0.0]]))
    assert (
        "to stop from 3.0 m/s it needs" in found.why
        and "the north side of the fence is 2.00 m away" in found.why
    )


def test_tilt_is_violated_after_its_duration() -> None:
    of = judge()
    leaning = moment([FAR], tilt=[np.radians(60.0)], now=10.0)
    assert of.violations(leaning) == []
    assert of.violations(replace(leaning, now=10.2)) == []
    assert named(of.violations(replace(leaning, now=10.31))) == [(0, "tilt")]
    assert of.violations(replace(leaning, now=10.4, tilt=np.zeros(1))) == []
    assert of.violations(replace(leaning, now=10.5)) == []  # the duration starts again


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
    assert named(judge(**section).violations(moment([FAR], **given_))) == [(0, rule)]
    assert judge(**section, **{rule: {"do": "none"}}).violations(moment([FAR], **given_)) == []


def test_estimate_is_violated_after_its_duration() -> None:
    of = judge()
    off = moment([FAR], off=[0.35])
    assert of.violations(off) == []
    assert named(of.violations(replace(off, now=10.51))) == [(0, "estimate")]


@pytest.mark.parametrize(
    "unknown",
    [
        {"battery": [np.nan]},
        {"silent_s": [np.nan]},
        {"off": [np.nan]},
        {"off": [np.inf]},
        {"target": [[np.nan] * 3]},
    ],
)
def test_unknown_values_violate_nothing(unknown: dict[str, Any]) -> None:
    assert judge().violations(moment([FAR], **unknown)) == []


def test_silent_program_outside_offboard_is_no_violation() -> None:
    assert judge().violations(moment([FAR], silent_s=[5.0], offboard=[False])) == []


def test_vehicle_without_a_recent_pose_violates_no_position_rule() -> None:
    lost = moment(
        [[9.0, 9.0, -9.0]], [[9.0, 0.0, 0.0]], placed=[False], moving=[False], tilt=[3.0], off=[9.0]
    )
    assert judge().violations(lost) == []


@given(st.data())
def test_vehicle_that_does_not_fly_violates_nothing(data: st.DataObject) -> None:
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
    assert {f.name for f in fields(FleetState)} >= {"flying"}
    of = judge(3)
    for later in (0.0, 1.0):
        assert all(made.flying[b.row] for b in of.violations(replace(made, now=10.0 + later)))
