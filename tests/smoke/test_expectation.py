"""Expectations: fulfilled, too late, never, or unknown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

from .synthetic_flights import (
    START_S,
    flight,
    judged,
    sentence,
    uav,
)

AT = "  - at: start\n  - expect: "


@pytest.mark.parametrize(
    ("expectation", "after"),
    [
        ("uav1.airborne within 2 s", 1.0),
        ("uav1.mode == LAND within 6 s", 5.02),
        ("uav1.mode == AUTO.LAND within 6 s", 5.02),
        ("uav1.mode != HOLD within 2 s", 1.0),
        ("uav1.mode == RTL or LAND within 6 s", 5.02),
        ("uav1.landed within 11 s", 10.0),
        ("uav1.height > 0.9 m within 1 s", 1.0),
        ("uav1.tilt < 5 deg within 1 s", 0.02),
        ("uav1.battery > 70 % within 1 s", 0.02),
        ("uav1.speed > 0.4 m/s within 6 s", 5.02),
        ("uav1.outside < -0.5 m within 1 s", 0.02),
        ("not uav1.landed for 3 s", 3.0),
        ("not each.armed for 900 ms", 0.9),
        ("separation > 0.5 m within 2 s", 1.0),
        ("inside geofence for 2 s", 2.0),
        ("uav1.touchdown < 0.6 m/s within 11 s", 10.0),
        ("not uav1.crashed for 1 s", 1.0),
    ],
)
def test_expectation_is_fulfilled_at_the_first_matching_observation(
    referee_for, expectation: str, after: float
) -> None:
    verdict = judged(referee_for(AT + expectation + "\n"))
    assert verdict.passed, verdict.failures
    at, step = verdict.steps
    assert at.kind == "at" and at.done_s == START_S
    assert (
        step.took_s == pytest.approx(after, abs=1e-6)
        and step.place.text == expectation
        and step.place.line == 11
    )


@pytest.mark.parametrize(
    ("expectation", "expected"),
    [
        (
            "uav1.mode == LAND within 2 s",
            "uav1.mode was AUTO.LOITER, then OFFBOARD; expected uav1.mode == LAND within 2 s",
        ),
        (
            "uav1.mode == LAND within 500 ms",
            "uav1.mode was AUTO.LOITER all the time; expected uav1.mode == LAND within 500 ms",
        ),
        ("uav1.airborne within 980 ms", "uav1 was on the floor all the time; expected"),
        (
            "uav1.landed within 9 s",
            "uav1 was on the floor, not flown yet, then in the air in OFFBOARD, then in the air in AUTO.LAND;",
        ),
        ("each.airborne within 2 s", "uav2 was on the floor all the time; expected each.airborne within 2 s"),
        ("uav1.height > 2 m within 2 s", "uav1.height was between 0.00 m and 1.00 m; expected"),
        ("uav1.battery < 20 % within 1 s", "uav1.battery was 80.00 % all the time; expected"),
        (
            "not uav1.airborne for 3 s",
            "uav1 was on the floor, then in the air; expected not uav1.airborne for 3 s (failed after 1.00 s)",
        ),
        ("uav1.airborne for 3 s", "(failed after 0.02 s)"),
        ("separation > 3 m within 2 s", "separation between uav1 and uav2 was 1.41 m all the time; expected"),
        ("uav1.estimate error < 1 m within 1 s", "uav1.estimate error was unknown; expected"),
        ("uav1.touchdown < 1 m/s within 2 s", "uav1.touchdown was unknown"),
        ("router is EXITED within 1 s", "router was unknown"),
        ('event "low battery" within 1 s', '"low battery" was not logged all the time; expected'),
        ("arena ended within 1 s", "the arena was running all the time"),
    ],
)
def test_failed_expectation_names_the_observed_values(referee_for, expectation: str, expected: str) -> None:
    verdict = judged(referee_for(AT + expectation + "\n"))
    assert expected in sentence(verdict)
    assert verdict.steps[1].outcome == "failed" and not verdict.passed and verdict.ended == "a step failed"


@pytest.mark.parametrize(
    ("expectation", "after"),
    [("uav1.mode == LAND within 500 ms", 0.5), ("not uav1.airborne for 3 s", 1.0)],
)
def test_failed_expectation_has_the_time_of_its_failure(referee_for, expectation: str, after: float) -> None:
    step = judged(referee_for(AT + expectation + "\n")).steps[1]
    assert step.done_s is None and step.failed_s == pytest.approx(START_S + after, abs=0.021)


def test_one_observation_too_late_fails(referee_for) -> None:
    assert judged(referee_for(AT + "uav1.mode == LAND within 5.02 s\n")).passed
    assert not judged(referee_for(AT + "uav1.mode == LAND within 5 s\n")).passed


def test_all_expectations_after_an_action_count_from_it(referee_for) -> None:
    steps = "  - at: uav1.airborne\n    do: rc loss uav1\n  - expect: uav1.landed within 9 s\n  - expect: uav1.mode == LAND within 5 s\n"
    verdict = judged(referee_for(steps))
    assert verdict.passed
    assert [round(s.took_s or 0.0, 2) for s in verdict.steps] == [0.0, 9.0, 4.02]


def test_failed_step_finishes_its_expectations_and_stops_the_flight(referee_for) -> None:
    steps = "  - at: uav1.airborne\n  - expect: uav1.mode == LAND within 1 s\n  - expect: uav1.height > 0.5 m for 3 s\n  - do: down\n"
    verdict = judged(referee_for(steps))
    assert [s.outcome for s in verdict.steps] == ["passed", "failed", "passed", "not reached"]
    assert verdict.lasted_s == pytest.approx(4.0)


UNKNOWN = {
    "uav1.mode == LAND": {"mode": ""},
    "uav1.mode != LAND": {"mode": ""},
    "not uav1.mode == LAND": {"mode": ""},
    "uav1.armed": {"armed": None},
    "not uav1.armed": {"armed": None},
    "uav1.battery > 1 %": {"battery": None},
    "not uav1.battery > 1 %": {"battery": None},
    "uav1.estimate error < 1 m": {},
    "tracking(uav1) < 1 m": {},
    "uav1.drift > 9 m": {},
}


@pytest.mark.parametrize("condition", UNKNOWN)
@pytest.mark.parametrize("how", ["within 1 s", "for 1 s"])
def test_unknown_value_fulfils_nothing(referee_for, condition: str, how: str) -> None:
    verdict = judged(referee_for(f"{AT}{condition} {how}\n"), lambda t: flight(t, **UNKNOWN[condition]))
    assert "was unknown" in sentence(verdict)


def test_short_silence_breaks_nothing(referee_for) -> None:
    quiet = judged(
        referee_for(AT + "uav1.armed for 3 s\n", may=["stay up"]),
        lambda t: {"uav1": uav("uav1", 1.0, armed=None if 1.0 < t < 2.0 else True)},
    )
    assert quiet.passed


def test_long_silence_fails_although_the_value_was_known_before(referee_for) -> None:
    lost = judged(
        referee_for(AT + "uav1.armed for 6 s\n", may=["stay up"]),
        lambda t: {"uav1": uav("uav1", 1.0, armed=None if t > 1.0 else True)},
    )
    assert "unknown for more than 2 s" in sentence(lost)


@pytest.mark.parametrize(("silent_s", "passes"), [(1.5, True), (3.0, False)])
def test_value_unknown_at_the_begin_fails_after_two_seconds(
    referee_for, silent_s: float, passes: bool
) -> None:
    verdict = judged(
        referee_for(AT + "uav1.armed for 6 s\n", may=["stay up"]),
        lambda t: {"uav1": uav("uav1", 1.0, armed=None if t < silent_s else True)},
    )
    assert verdict.passed is passes
    assert passes or "unknown for more than 2 s" in sentence(verdict)
    assert passes or verdict.steps[1].failed_s == pytest.approx(START_S + 2.02, abs=0.021)


def test_nan_setpoint_is_unknown(referee_for) -> None:
    nan = (math.nan, 0.0, 0.0)
    assert "unknown" in sentence(
        judged(referee_for(AT + "tracking(uav1) < 1 m for 2 s\n"), lambda t: flight(t, target_p_n=nan))
    )


def test_tracking_and_estimate_are_compared_with_the_truth(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return flight(t, target_p_n=(1.3, 0.4, -1.0), est_p_n=(1.0, 0.0, -1.2))

    assert judged(
        referee_for("  - at: uav1.airborne\n  - expect: tracking(uav1) > 0.49 m for 2 s\n"), script
    ).passed
    assert judged(
        referee_for("  - at: uav1.airborne\n  - expect: uav1.estimate error > 0.19 m for 2 s\n"), script
    ).passed
    verdict = judged(
        referee_for("  - at: uav1.airborne\n  - expect: tracking(uav1) < 0.49 m within 2 s\n"), script
    )
    assert "tracking(uav1) was 0.50 m all the time" in sentence(verdict)


def test_event_before_the_step_does_not_count(referee_for) -> None:
    steps = '  - at: start + 2 s\n  - expect: event "Low Battery" within 3 s\n'
    assert not judged(referee_for(steps), events={1.0: "uav1: low battery"}).passed
    assert judged(referee_for(steps), events={3.0: "uav1: low battery"}).passed


def test_process_states_are_observed(referee_for) -> None:
    def processes(t: float) -> Mapping[str, str]:
        return {"program.uav1": "READY" if t < 1.0 else "EXITED", "router": "READY"}

    verdict = judged(referee_for(AT + "program uav1 is EXITED within 2 s\n"), processes=processes)
    assert verdict.passed and verdict.steps[1].took_s == pytest.approx(1.0)
    assert judged(referee_for(AT + "router is READY for 2 s\n"), processes=processes).passed
    assert "program.uav1 was READY, then EXITED" in sentence(
        judged(referee_for(AT + "program uav1 is READY for 2 s\n"), processes=processes)
    )
