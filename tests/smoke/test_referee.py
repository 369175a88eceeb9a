"""The end of a flight, the rules that hold by default, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from arena.smoke.language.model import Observation, VehicleState
from arena.smoke.referee.verdict import Result, Verdict
from arena.smoke.report import details, junit_xml, reasons, results_json

from .synthetic_flights import (
    BROKEN,
    DOWN_S,
    FLOWN,
    START_S,
    flight,
    flown_with_faults,
    fly,
    judged,
    sentence,
    uav,
)


def test_flight_ends_when_all_vehicles_are_down(referee_for) -> None:
    verdict = judged(referee_for("  - at: uav1.airborne\n"))
    assert (
        verdict.passed and verdict.ended == "all steps are done" and verdict.lasted_s == pytest.approx(DOWN_S)
    )


def test_armed_vehicle_on_the_floor_is_not_down(referee_for) -> None:
    verdict = judged(referee_for("  - at: uav1.airborne\n"), lambda t: flight(t, armed=True))
    assert (
        sentence(verdict) == "uav1 was on the floor and still armed, the time limit of 15 s came at 20.00 s"
    )


def test_vehicle_in_the_air_at_the_time_limit_fails(referee_for) -> None:
    verdict = judged(referee_for("  - at: uav1.airborne\n", time_limit_s=8))
    assert (
        sentence(verdict)
        == "uav1 was in the air in AUTO.LAND, 1.00 m above the floor, the time limit of 8 s came at 13.00 s"
    )
    assert judged(referee_for("  - at: uav1.airborne\n", may=["stay up"], time_limit_s=8)).passed


def test_step_whose_trigger_never_comes_fails(referee_for) -> None:
    verdict = judged(
        referee_for("  - at: uav2.airborne + 3 s\n    do: land all\n  - expect: uav2.landed within 2 s\n")
    )
    assert (
        sentence(verdict) == "uav2.airborne + 3 s never came: the time limit of 15 s came first, at 20.00 s"
    )
    assert [s.outcome for s in verdict.steps] == ["failed", "not reached"]


def test_time_limit_closes_an_expectation(referee_for) -> None:
    verdict = judged(
        referee_for("  - at: uav1.airborne\n  - expect: uav2.airborne within 20 s\n", time_limit_s=5)
    )
    assert "uav2 was on the floor all the time" in sentence(
        verdict
    ) and "the time limit of 5 s came after 4.00 s" in sentence(verdict)


def test_arena_that_ends_by_itself_fulfils_arena_ended(referee_for) -> None:
    steps = "  - at: uav1.airborne\n    do: kill world\n  - expect: arena ended within 10 s\n"
    referee = referee_for(steps, may=["stay up"])
    fly(referee, until=3.0)
    assert not referee.over
    referee.finish({"failed": ["world: killed by SIGKILL"]})
    assert referee.verdict().passed


def test_arena_ended_at_the_time_limit_did_not_end_by_itself(referee_for) -> None:
    assert not judged(
        referee_for("  - at: uav1.airborne\n  - expect: arena ended within 100 s\n", may=["stay up"])
    ).passed


def test_arena_that_ends_early_fails(referee_for) -> None:
    verdict = judged(referee_for("  - at: uav1.airborne\n  - expect: uav1.landed within 20 s\n"), until=3.0)
    assert "the end of the arena came after 1.98 s" in sentence(verdict)


def test_arena_that_did_not_start_fails(referee_for) -> None:
    referee = referee_for("  - at: uav1.airborne\n", ["inside geofence"])
    referee.finish({}, "router: not ready after 30 s")
    verdict = referee.verdict()
    assert (None, "router: not ready after 30 s") in verdict.failures and not verdict.passed
    assert verdict.rules[0].outcome == "not reached"


def test_crash_fails_unless_allowed(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return flight(t, crashed="hit the wall" if t > 3.0 else "")

    assert sentence(judged(referee_for(FLOWN), script)) == "uav1 crashed: hit the wall"
    assert judged(referee_for(FLOWN, may=["crash uav1"]), script).passed
    assert not judged(referee_for(FLOWN, may=["crash uav2"]), script).passed


def test_crash_reported_by_the_supervisor_fails(referee_for) -> None:
    outcome = {"failed": ["uav1 crashed: 12.1 s: tilt 70 deg"]}
    assert sentence(judged(referee_for(FLOWN), outcome=outcome)) == "uav1 crashed: 12.1 s: tilt 70 deg"
    assert judged(referee_for(FLOWN, may=["crash each"]), outcome=outcome).passed


def test_crashed_vehicle_is_not_waited_for(referee_for) -> None:
    verdict = judged(
        referee_for(FLOWN, may=["crash uav1"]),
        lambda t: flight(t, armed=True, crashed="hit the wall" if t > 3.0 else ""),
    )
    assert verdict.passed and verdict.lasted_s == pytest.approx(DOWN_S)


def test_failed_process_fails_unless_targeted_or_allowed(referee_for) -> None:
    outcome = {"failed": ["program.uav1: killed by SIGKILL", "the landing was not confirmed"]}
    expected = sentence(judged(referee_for(FLOWN), outcome=outcome))
    assert expected == "program.uav1: killed by SIGKILL (to accept this, write `may: [fail program.uav1]`)"
    assert judged(referee_for(FLOWN, may=["fail program.uav1"]), outcome=outcome).passed
    assert judged(referee_for(FLOWN + "    do: kill program uav1\n"), outcome=outcome).passed
    assert judged(referee_for(FLOWN, may=["fail program uav1"]), outcome=outcome).passed
    assert not judged(referee_for(FLOWN + "    do: kill router\n"), outcome=outcome).passed


def test_action_that_was_not_reached_allows_nothing(referee_for) -> None:
    steps = FLOWN + "    expect: uav2.airborne within 1 s\n  - do: kill program uav1\n"
    verdict = judged(referee_for(steps), outcome={"failed": ["program.uav1: ended with code 1"]})
    assert any(expected.startswith("program.uav1: ended with code 1") for _, expected in verdict.failures)


def test_fatal_process_fails(referee_for) -> None:
    verdict = judged(referee_for(FLOWN), processes=lambda t: {"logger.uav1": "FATAL" if t > 3.0 else "READY"})
    assert sentence(verdict).startswith("logger.uav1: is FATAL")


def test_other_failure_of_the_arena_fails(referee_for) -> None:
    assert (
        sentence(judged(referee_for(FLOWN), outcome={"failed": ["the disk is full"]})) == "the disk is full"
    )


def test_run_without_an_outcome_fails(referee_for) -> None:
    referee = referee_for(FLOWN)
    fly(referee)
    referee.finish(None)
    verdict = referee.verdict()
    assert sentence(verdict) == "the run has no outcome: its supervisor has ended without a result"
    assert [r.outcome for r in verdict.rules if r.place.text == "no process fails"] == ["not reached"]


@pytest.mark.parametrize("do", ["kill supervisor", "hang supervisor"])
def test_scenario_that_ends_its_supervisor_needs_no_outcome(referee_for, do: str) -> None:
    referee = referee_for(f"{FLOWN}    do: {do}\n")
    fly(referee)
    referee.finish(None)
    assert referee.verdict().passed, referee.verdict().failures


def test_missing_outcome_of_an_arena_that_did_not_start_is_not_reported_twice(referee_for) -> None:
    referee = referee_for(FLOWN)
    referee.finish(None, "router: not ready after 30 s")
    assert [text for place, text in referee.verdict().failures if place is None] == [
        "router: not ready after 30 s"
    ]


def test_default_rules_have_the_place_of_the_scenario(referee_for) -> None:
    places = [rule.place for rule in judged(referee_for(FLOWN)).rules]
    assert [p.text for p in places] == [
        "no vehicle crashes",
        "all vehicles have landed at the end",
        "no process fails",
    ]
    assert {(p.file, p.line) for p in places} == {("s.yaml", 1)}


def test_touchdown_counts_from_the_last_action(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        aside = 0.1 * max(0.0, min(t, DOWN_S) - 4.0)
        return flight(t, p_n=(1.0, aside, -1.0), v_n=(0.0, 0.1, 0.7))

    (touchdown,) = judged(
        referee_for("  - at: uav1.airborne + 3 s\n    do: kill program uav1\n"), script
    ).touchdowns
    assert touchdown.vehicle == "uav1" and touchdown.at_s == pytest.approx(START_S + DOWN_S)
    assert touchdown.after_s == pytest.approx(6.0) and touchdown.drift_m == pytest.approx(0.6)
    assert touchdown.speed_m_s == pytest.approx(math.hypot(0.1, 0.7))


def test_touchdown_without_an_action_has_no_drift(referee_for) -> None:
    (touchdown,) = judged(referee_for(FLOWN)).touchdowns
    assert touchdown.after_s is None and touchdown.drift_m is None


def test_bounce_is_not_a_touchdown(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        bounces = 10.1 <= t < 10.2
        return {"uav1": uav("uav1", 0.02, v_n=(0.0, 0.0, 0.1))} if bounces else flight(t, v_n=(0.0, 0.0, 0.7))

    (touchdown,) = judged(referee_for("  - at: start + 12 s\n"), script).touchdowns
    assert touchdown.at_s == pytest.approx(START_S + DOWN_S) and touchdown.speed_m_s == pytest.approx(0.7)


def test_same_observations_give_the_same_verdict(referee_for) -> None:
    steps = "  - at: uav1.airborne + 1 s\n    do: kill program uav1\n  - expect: each.landed within 9 s\n"
    verdicts = [
        flown_with_faults(referee_for(steps, list(BROKEN)), {"v_n": (0.0, 0.0, 1.5)}) for _ in range(2)
    ]
    assert verdicts[0] == verdicts[1]


number = st.one_of(st.floats(-5.0, 5.0), st.just(math.nan))
vector = st.tuples(number, number, number)


@st.composite
def anything(draw, name: str) -> VehicleState:
    return VehicleState(
        name=name,
        p_n=draw(vector),
        v_n=draw(vector),
        tilt_rad=draw(number),
        height_m=draw(number),
        airborne=draw(st.booleans()),
        mode=draw(st.sampled_from(["", "OFFBOARD", "AUTO.LAND"])),
        armed=draw(st.sampled_from([None, True, False])),
        est_p_n=draw(st.none() | vector),
        target_p_n=draw(st.none() | vector),
        battery=draw(st.none() | st.floats(0.0, 1.0)),
        crashed=draw(st.sampled_from(["", "", "hit the wall"])),
    )


observations = st.lists(
    st.tuples(
        st.floats(0.02, 3.0),
        st.lists(st.one_of(anything("uav1"), anything("uav2")), max_size=2),
        st.sampled_from([(), ("critical",)]),
        st.sampled_from(["", "READY", "FATAL", "EXITED"]),
    ),
    max_size=25,
)
STEPS = """\
  - at: uav1.airborne + 1 s
    do: [mocap dropout each for 1 s, kill program uav1]
    expect: [uav1.mode == LAND within 2 s, not each.landed for 1 s, each.estimate error < 3 m within 4 s, uav1.drift < 9 m for 1 s]
  - at: then + 1 s
    expect: [separation > 0.5 m for 1 s, inside geofence within 2 s, tracking(each) < 9 m within 9 s, program uav1 is EXITED within 5 s]
"""


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(observations, st.sampled_from(["", "router: not ready"]))
def test_any_observations_give_a_repeatable_verdict(referee_for, seen, problem: str) -> None:
    def verdict() -> Verdict:
        referee, now = referee_for(STEPS, list(BROKEN)), 0.0
        for wait, vehicles, events, state in seen:
            now += wait
            if not referee.over:
                processes = {"program.uav1": state} if state else {}
                referee.observe(
                    Observation(
                        time_s=now, vehicles={v.name: v for v in vehicles}, events=events, processes=processes
                    )
                )
        referee.finish({"failed": ["program.uav1: exit 1"]}, problem)
        return referee.verdict()

    first = verdict()
    result = Result(scenario="s", file="s.yaml", seed=1, verdict=first)
    assert first.passed == (not reasons(result))
    assert results_json([result]) == results_json(
        [replace(result, verdict=verdict())]
    )  # NaN is not equal to itself, its text is
    assert ElementTree.fromstring(junit_xml([result])).find(".//testcase") is not None
    assert details(result)
