"""Rules of `always`: what breaks them and what they report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from arena.smoke.language.model import Observation
from arena.smoke.referee.referee import Referee
from arena.smoke.referee.verdict import RuleResult

from .synthetic_flights import (
    BROKEN,
    FLOWN,
    START_S,
    STEP_S,
    UP_S,
    both,
    flight,
    flown_with_faults,
    judged,
    sentence,
    uav,
)


def on_their_setpoints(t: float) -> Mapping[str, Any]:
    """Return both vehicles, each at its position setpoint."""
    return {name: replace(v, target_p_n=v.p_n) for name, v in both(t).items()}


@pytest.mark.parametrize("rule", BROKEN)
def test_broken_rule_reports_its_worst_value(referee_for, rule: str) -> None:
    more, expected = BROKEN[rule]
    result = flown_with_faults(referee_for(FLOWN, [rule], may=["crash each"]), more).rules[0]
    assert result.outcome == "failed" and expected in result.failure
    assert result.place.line == 9 and result.place.text == rule


KEPT = {
    "separation > 0.5 m": (0.6, "uav1 and uav2"),
    "uav1.tilt < 10 deg": (0.0, "uav1"),
    "each.speed < 1 m/s": (0.5, "uav1"),
    "uav2.battery > 70 %": (80.0, "uav2"),
    "inside geofence": (-2.0, "uav2"),
    "not each.crashed": (None, "uav1"),
    "tracking(uav2) < 1 m rms": (0.5, "uav2"),
    'not event "panic"': (None, ""),
    "uav1.height < 1.1 m": (1.0, "uav1"),
}


@pytest.mark.parametrize("rule", KEPT)
def test_kept_rule_reports_its_nearest_value(referee_for, rule: str) -> None:
    def script(t: float) -> Mapping[str, Any]:
        made = both(t, v_n=(0.0, 0.5, 0.0))
        return {name: replace(v, target_p_n=(v.p_n[0], 0.5, v.p_n[2])) for name, v in made.items()}

    verdict = judged(referee_for(FLOWN, [rule]), script)
    assert verdict.passed, verdict.failures
    worst, who = KEPT[rule]
    assert verdict.rules[0].outcome == "passed" and verdict.rules[0].who == who
    assert verdict.rules[0].worst == (None if worst is None else pytest.approx(worst))


def test_rule_holds_in_flight_only(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return both(t, tilt_rad=1.0 if t < 0.5 or t > 6.5 else 0.1)

    steps = "  - at: start + 8 s\n"
    assert judged(referee_for(steps, ["each.tilt < 40 deg"]), script).passed


def test_vehicle_on_the_floor_is_not_judged(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return {**flight(t), "uav2": uav("uav2", tilt_rad=1.0, p_n=(9.0, 0.0, 0.0))}

    verdict = judged(referee_for(FLOWN, ["each.tilt < 40 deg", "inside geofence"]), script)
    assert verdict.passed and verdict.rules[0].who == "uav1"


@pytest.mark.parametrize("rule", ["each.battery > 20 %", "tracking(each) < 1 m", "each.mode != RTL"])
def test_rule_about_a_value_that_one_vehicle_never_sent_fails(referee_for, rule: str) -> None:
    def script(t: float, silent: Mapping[str, Any]) -> Mapping[str, Any]:
        made = on_their_setpoints(t)
        return {**made, "uav2": replace(made["uav2"], **silent)}

    assert judged(referee_for(FLOWN, [rule]), lambda t: script(t, {})).passed
    silent = {"battery": None, "target_p_n": None} if "mode" not in rule else {"mode": ""}
    result = judged(referee_for(FLOWN, [rule]), lambda t: script(t, silent)).rules[0]
    assert result.outcome == "failed"
    assert result.failure == "the rule could not be evaluated for uav2: the value was never received"


@pytest.mark.parametrize(("silent_s", "passes"), [(1.5, True), (3.0, False)])
def test_rule_about_a_value_that_is_lost_in_flight_fails(referee_for, silent_s: float, passes: bool) -> None:
    def script(t: float) -> Mapping[str, Any]:
        lost = {"battery": None} if 3.0 <= t < 3.0 + silent_s else {}
        return {**both(t), "uav1": replace(both(t)["uav1"], **lost)}

    result = judged(referee_for(FLOWN, ["each.battery > 20 %"]), script).rules[0]
    assert (result.outcome == "passed") is passes, result.failure
    assert passes or "for uav1 for 3.0 s: the value was not received" in result.failure


@pytest.mark.parametrize(("silent_s", "passes"), [(1.5, True), (3.0, False)])
@pytest.mark.parametrize("rule", ["tracking(each) < 0.1 m", "tracking(uav1) < 0.1 m rms"])
def test_tracking_rule_fails_if_all_telemetry_is_lost(
    referee_for, rule: str, silent_s: float, passes: bool
) -> None:
    def script(t: float) -> Mapping[str, Any]:
        made = on_their_setpoints(t)
        lost = {"mode": "", "target_p_n": None, "armed": None} if 2.0 <= t < 2.0 + silent_s else {}
        return {**made, "uav1": replace(made["uav1"], **lost)}

    result = judged(referee_for(FLOWN, [rule]), script).rules[0]
    assert (result.outcome == "passed") is passes, result.failure
    assert passes or "for uav1 for 3.0 s: the value was not received" in result.failure


def test_tracking_rule_fails_if_a_vehicle_never_sent_telemetry(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        made = on_their_setpoints(t)
        return {**made, "uav2": replace(made["uav2"], mode="", target_p_n=None)}

    result = judged(referee_for(FLOWN, ["tracking(each) < 0.1 m"]), script).rules[0]
    assert result.failure == "the rule could not be evaluated for uav2: the value was never received"


def test_lost_telemetry_after_offboard_needs_no_setpoint(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        made = replace(both(t)["uav1"], target_p_n=both(t)["uav1"].p_n)
        held = {"mode": "AUTO.LOITER" if t < 2.5 else "", "target_p_n": None} if t >= 2.0 and t < 5.9 else {}
        return {**both(t), "uav1": replace(made, **held)}

    result = judged(referee_for(FLOWN, ["tracking(uav1) < 1 m"]), script).rules[0]
    assert result.outcome == "passed", result.failure


@pytest.mark.parametrize(("silent_s", "passes"), [(1.5, True), (3.0, False)])
@pytest.mark.parametrize("rule", ["each.battery > 20 %", "uav1.mode != RTL", "tracking(uav1) < 1 m"])
def test_rule_about_a_value_that_is_unknown_after_takeoff_fails(
    referee_for, rule: str, silent_s: float, passes: bool
) -> None:
    def script(t: float) -> Mapping[str, Any]:
        made = on_their_setpoints(t)
        lost = {"battery": None, "mode": "", "target_p_n": None} if t < UP_S + silent_s else {}
        return {**made, "uav1": replace(made["uav1"], **lost)}

    result = judged(referee_for(FLOWN, [rule]), script).rules[0]
    assert (result.outcome == "passed") is passes, result.failure
    assert passes or "for uav1 for 3.0 s: the value was not received" in result.failure


def test_tracking_between_two_parts_in_offboard_need_not_be_known(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        held = {"mode": "AUTO.LOITER"} if 2.0 <= t < 5.0 else {}
        target = {} if 2.0 <= t < 5.5 else {"target_p_n": both(t)["uav1"].p_n}
        return {**both(t), "uav1": replace(both(t)["uav1"], **held, **target)}

    result = judged(referee_for(FLOWN, ["tracking(uav1) < 1 m"]), script).rules[0]
    assert result.outcome == "passed", result.failure


def test_rms_is_over_offboard_only(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        off = 0.3 if 2.0 <= t < 4.0 else 0.1
        mode = "AUTO.LAND" if t >= 5.0 else "OFFBOARD"
        return both(t, mode=mode, target_p_n=(1.0, 9.0 if t >= 5.0 else off, -1.0))

    rule = judged(referee_for(FLOWN, ["tracking(uav1) < 1 m rms"]), script).rules[0]
    assert rule.worst == pytest.approx(math.sqrt((0.3**2 + 0.1**2) / 2), rel=1e-2) and rule.unit == "m"


def test_rule_without_any_value_fails(referee_for) -> None:
    expected = sentence(judged(referee_for(FLOWN, ["tracking(uav1) < 1 m rms"])))
    assert (
        expected
        == "the rule could not be evaluated: no position setpoint was received in OFFBOARD and in the air"
    )
    assert "no vehicle took off" in sentence(judged(referee_for("  - at: start\n", ["inside geofence"])))


def observed_at(referee: Referee, wall_per_sim: float) -> RuleResult:
    """Fly at a constant pace and return the result of the first rule. wall_per_sim: wall time per simulated second."""
    for k in range(800):
        t = k * STEP_S
        # The world runs at full speed before the take-off: only the flight counts.
        wall = 0.1 * t if t < UP_S else 0.1 * UP_S + wall_per_sim * (t - UP_S)
        referee.observe(Observation(time_s=START_S + t, vehicles=flight(t), wall_s=wall))
        if referee.over:
            break
    referee.finish({})
    return referee.verdict().rules[0]


def test_flight_below_real_time_breaks_the_rule(referee_for) -> None:
    result = observed_at(referee_for(FLOWN, ["real time factor > 0.95"]), 1 / 0.65)
    assert result.outcome == "failed" and result.worst == pytest.approx(0.65, abs=1e-6)
    assert result.failure == "real time factor was 0.65 at 15.00 s; expected more than 0.95"


def test_flight_in_real_time_keeps_the_rule(referee_for) -> None:
    result = observed_at(referee_for(FLOWN, ["real time factor > 0.95"]), 1.0)
    assert result.outcome == "passed" and result.worst == pytest.approx(1.0)


def test_real_time_factor_without_wall_time_fails_as_unobserved(referee_for) -> None:
    verdict = judged(referee_for(FLOWN, ["real time factor > 0.95"]))
    assert "the rule could not be evaluated: the flight was shorter than 1 s" in sentence(verdict)
