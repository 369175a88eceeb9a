"""The referee on flights made by hand: what is done when; what is fulfilled, too late, never or unknown; what breaks a rule."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from arena.smoke.language.model import Now, VehicleNow
from arena.smoke.language.scenario import load_scenarios
from arena.smoke.referee.referee import Referee
from arena.smoke.referee.verdict import Result, Verdict
from arena.smoke.report import junit_xml, reasons, results_json, story

HEAD = """\
arena:
  world: {size: [10, 10, 4]}
  vehicles:
    uav1: {program: fly.py}
    uav2: {start: {position: [2, 0, 0]}}
"""
START_S = 5.0  # of the first look: a simulation has run for a while when its arena is up
UP_S, DOWN_S = 1.0, 10.0  # after the first look: take-off and touchdown of uav1, as `flight` has them
STEP_S = 0.02

Script = Callable[[float], Mapping[str, Any]]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Referee]:
    monkeypatch.chdir(tmp_path)
    Path("fly.py").touch()

    def referee(
        steps: str, always: Iterable[str] = (), may: Iterable[str] = (), time_limit_s: float = 15.0
    ) -> Referee:
        text = (
            HEAD
            + f"time_limit_s: {time_limit_s}\nmay: [{', '.join(may)}]\nalways:"
            + (" []" if not always else "")
            + "\n"
        )
        Path("s.yaml").write_text(text + "".join(f"  - {rule}\n" for rule in always) + "steps:\n" + steps)
        return Referee(load_scenarios("s.yaml")[0])

    return referee


def uav(name: str = "uav1", height: float = 0.0, **more: Any) -> VehicleNow:
    """Standing or hovering, north of the origin by its number."""
    place = (float(name[3:]), 0.0, -height)
    told = {"mode": "OFFBOARD" if height else "AUTO.LOITER", "armed": height > 0.0, "battery": 0.8, **more}
    base = VehicleNow(
        name=name, p_n=place, v_n=(0.0, 0.0, 0.0), tilt_rad=0.0, height_m=height, airborne=height > 0.0
    )
    return replace(base, **told)


def flight(t: float, **more: Any) -> Mapping[str, Any]:
    """uav1 flies at 1 m from UP_S to DOWN_S; in LAND at the end. t: since the first look [s]."""
    aloft = UP_S <= t < DOWN_S - 1e-9
    told = {"mode": "AUTO.LAND", "v_n": (0.0, 0.0, 0.5)} if aloft and t > 5.0 else {}
    return {"uav1": uav("uav1", 1.0 if aloft else 0.0, **{**told, **more}), "uav2": uav("uav2")}


def fly(
    referee: Referee,
    script: Script = flight,
    until: float = 40.0,
    events: Mapping[float, str] | None = None,
    processes: Script = lambda t: {},
) -> list[tuple[float, str, bool]]:
    """Looks until it is over; what was done: (seconds since the first look, the deed's text, whether it was taken back)."""
    done = []
    for k in range(round(until / STEP_S)):
        t = k * STEP_S
        told = tuple(text for at, text in (events or {}).items() if abs(at - t) < STEP_S / 2)
        deeds = referee.look(Now(time_s=START_S + t, vehicles=script(t), processes=processes(t), events=told))
        done += [(round(t, 2), deed.place.text, deed.undo) for deed in deeds]
        if referee.over:
            break
    return done


def judged(
    referee: Referee, script: Script = flight, outcome: Mapping[str, Any] | None = None, **more: Any
) -> Verdict:
    fly(referee, script, **more)
    referee.finish(outcome or {})
    return referee.verdict()


def sentence(verdict: Verdict) -> str:
    """The only failure."""
    ((_, told),) = verdict.failures
    return told


# -- moments and deeds --------------------------------------------------------------------------------------------------------


def test_a_deed_is_due_at_its_moment_and_once(write) -> None:
    assert fly(write("  - at: uav1.airborne + 3 s\n    do: kill program uav1\n")) == [
        (4.0, "kill program uav1", False)
    ]


MOMENTS = {
    "start": 0.0,
    "start + 500 ms": 0.5,
    "then + 2 s": 2.0,
    "uav1.airborne": 1.0,
    "not uav1.airborne": 0.0,
    "uav1.armed": 1.0,
    "uav1.mode == LAND + 1 s": 6.02,
    "uav1.height > 0.5 m": 1.0,
    "uav1.landed + 1 s": 11.0,
    "separation > 0.5 m": 1.0,
    "uav1.touchdown < 1 m/s": 10.0,
    "not uav1.mode == OFFBOARD + 1 s": 1.0,
}


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_moment_comes_when_it_should(write, moment: str) -> None:
    ((at, _, _),) = fly(write(f"  - at: {moment}\n    do: rc loss uav1\n", may=["stay up"]))
    assert at == pytest.approx(MOMENTS[moment], abs=1e-9)


def test_a_moment_that_came_before_its_turn_counts_from_when_it_came(write) -> None:
    steps = "  - at: start + 3 s\n    do: rc loss uav1\n  - at: uav1.airborne + 1 s\n    do: rc loss uav2\n"
    assert [at for at, _, _ in fly(write(steps))] == [3.0, 3.0]


def test_a_silence_is_no_further_coming_of_a_moment(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return flight(t, armed=None if 1.5 < t < 2.0 else t >= 1.0)

    assert fly(write("  - at: uav1.armed + 3 s\n    do: rc loss uav1\n"), script)[0][0] == 4.0


def test_a_moment_that_comes_again_counts_from_then(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return flight(t, armed=t >= 1.0 and not 1.5 < t < 2.0)

    assert fly(write("  - at: uav1.armed + 3 s\n    do: rc loss uav1\n"), script)[0][0] == 5.0


def test_then_counts_from_when_the_last_expectation_was_fulfilled(write) -> None:
    steps = "  - do: rc loss uav1\n  - expect: uav1.airborne within 5 s\n  - at: then + 1 s\n    do: rc loss uav2\n"
    assert fly(write(steps)) == [(0.0, "rc loss uav1", False), (2.0, "rc loss uav2", False)]


def test_several_deeds_at_once_in_their_order(write) -> None:
    steps = "  - at: start\n    do: [rc loss uav1, rc loss uav2]\n  - do: down\n"
    assert [text for _, text, _ in fly(write(steps))] == ["rc loss uav1", "rc loss uav2", "down"]


def test_a_deed_is_taken_back_after_its_time(write) -> None:
    steps = "  - at: uav1.airborne\n    do: mocap dropout uav1 for 2 s\n  - at: then + 1 s\n    do: down\n"
    assert fly(write(steps)) == [
        (1.0, "mocap dropout uav1 for 2 s", False),
        (2.0, "down", False),
        (3.0, "mocap dropout uav1 for 2 s", True),
    ]


def test_what_is_taken_back_is_the_same_deed(write) -> None:
    referee = write("  - do: link loss 30 % each for 20 ms\n", may=["stay up"])
    (deed,) = referee.look(Now(time_s=0.0, vehicles={}))
    (undone,) = referee.look(Now(time_s=0.02, vehicles={}))
    assert undone == replace(deed, undo=True) and not deed.undo and deed.vehicles == ("uav1", "uav2")


def test_a_deed_that_cannot_be_done_is_a_failed_step(write) -> None:
    referee = write("  - do: kill router\n    expect: uav1.landed within 20 s\n")
    (deed,) = referee.look(Now(time_s=0.0, vehicles=flight(0.0)))
    referee.refused(deed, "no process router")
    assert referee.over
    referee.finish({"failed": ["router: ended with code 1"]})
    failures = [told for _, told in referee.verdict().failures]
    assert failures[0] == "kill router could not be done: no process router"
    assert (
        "no process router" not in failures[-1] and "router: ended with code 1" in failures[-1]
    )  # it was not hit


def test_a_deed_that_cannot_be_taken_back_is_a_failed_step(write) -> None:
    referee = write("  - do: rc loss uav1 for 20 ms\n    expect: uav1.landed within 20 s\n")
    referee.look(Now(time_s=0.0, vehicles=flight(0.0)))
    (undo,) = referee.look(Now(time_s=0.02, vehicles=flight(0.0)))
    referee.refused(undo, "nobody takes faults there")
    assert (
        referee.over
        and "could not be taken back: nobody takes faults there" in referee.verdict().failures[0][1]
    )


# -- expectations -------------------------------------------------------------------------------------------------------------

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
def test_an_expectation_is_fulfilled_at_the_first_look_that_shows_it(
    write, expectation: str, after: float
) -> None:
    verdict = judged(write(AT + expectation + "\n"))
    assert verdict.passed, verdict.failures
    at, step = verdict.steps
    assert at.kind == "at" and at.done_s == START_S
    assert (
        step.took_s == pytest.approx(after, abs=1e-6)
        and step.place.text == expectation
        and step.place.line == 11
    )


@pytest.mark.parametrize(
    ("expectation", "told"),
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
            "uav1 was on the floor, then in the air; expected not uav1.airborne for 3 s (not so any more after 1.00 s)",
        ),
        ("uav1.airborne for 3 s", "(not so any more after 0.02 s)"),
        ("separation > 3 m within 2 s", "separation between uav1 and uav2 was 1.41 m all the time; expected"),
        ("uav1.estimate error < 1 m within 1 s", "uav1.estimate error was not heard; expected"),
        ("uav1.touchdown < 1 m/s within 2 s", "uav1.touchdown was not heard"),
        ("router is EXITED within 1 s", "router was not heard"),
        ('told "low battery" within 1 s', '"low battery" was not told all the time; expected'),
        ("arena ended within 1 s", "the arena was there all the time"),
    ],
)
def test_an_expectation_that_is_not_fulfilled_says_what_was_seen(write, expectation: str, told: str) -> None:
    verdict = judged(write(AT + expectation + "\n"))
    assert told in sentence(verdict)
    assert verdict.steps[1].outcome == "failed" and not verdict.passed and verdict.ended == "a step failed"


def test_on_time_and_too_late_are_one_look_apart(write) -> None:
    assert judged(write(AT + "uav1.mode == LAND within 5.02 s\n")).passed
    assert not judged(write(AT + "uav1.mode == LAND within 5 s\n")).passed


def test_all_expectations_after_a_deed_count_from_it_though_the_later_is_fulfilled_first(write) -> None:
    steps = "  - at: uav1.airborne\n    do: rc loss uav1\n  - expect: uav1.landed within 9 s\n  - expect: uav1.mode == LAND within 5 s\n"
    verdict = judged(write(steps))
    assert verdict.passed
    assert [round(s.took_s or 0.0, 2) for s in verdict.steps] == [0.0, 9.0, 4.02]


def test_after_a_failed_step_no_other_begins_but_its_own_expectations_are_seen_to_their_end(write) -> None:
    steps = "  - at: uav1.airborne\n  - expect: uav1.mode == LAND within 1 s\n  - expect: uav1.height > 0.5 m for 3 s\n  - do: down\n"
    verdict = judged(write(steps))
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
def test_what_is_unknown_fulfils_nothing(write, condition: str, how: str) -> None:
    verdict = judged(write(f"{AT}{condition} {how}\n"), lambda t: flight(t, **UNKNOWN[condition]))
    assert "was not heard" in sentence(verdict)


def test_a_moment_of_silence_breaks_nothing(write) -> None:
    quiet = judged(
        write(AT + "uav1.armed for 3 s\n", may=["stay up"]),
        lambda t: {"uav1": uav("uav1", 1.0, armed=None if 1.0 < t < 2.0 else True)},
    )
    assert quiet.passed


def test_a_setpoint_that_is_no_number_is_unknown(write) -> None:
    nan = (math.nan, 0.0, 0.0)
    assert "not heard" in sentence(
        judged(write(AT + "tracking(uav1) < 1 m for 2 s\n"), lambda t: flight(t, target_p_n=nan))
    )


def test_tracking_and_estimate_are_held_against_the_truth(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return flight(t, target_p_n=(1.3, 0.4, -1.0), est_p_n=(1.0, 0.0, -1.2))

    assert judged(
        write("  - at: uav1.airborne\n  - expect: tracking(uav1) > 0.49 m for 2 s\n"), script
    ).passed
    assert judged(
        write("  - at: uav1.airborne\n  - expect: uav1.estimate error > 0.19 m for 2 s\n"), script
    ).passed
    verdict = judged(write("  - at: uav1.airborne\n  - expect: tracking(uav1) < 0.49 m within 2 s\n"), script)
    assert "tracking(uav1) was 0.50 m all the time" in sentence(verdict)


def test_what_was_told_before_does_not_count(write) -> None:
    steps = '  - at: start + 2 s\n  - expect: told "Low Battery" within 3 s\n'
    assert not judged(write(steps), events={1.0: "uav1: low battery"}).passed
    assert judged(write(steps), events={3.0: "uav1: low battery"}).passed


def test_states_of_processes(write) -> None:
    def processes(t: float) -> Mapping[str, str]:
        return {"program.uav1": "READY" if t < 1.0 else "EXITED", "router": "READY"}

    verdict = judged(write(AT + "program uav1 is EXITED within 2 s\n"), processes=processes)
    assert verdict.passed and verdict.steps[1].took_s == pytest.approx(1.0)
    assert judged(write(AT + "router is READY for 2 s\n"), processes=processes).passed
    assert "program.uav1 was READY, then EXITED" in sentence(
        judged(write(AT + "program uav1 is READY for 2 s\n"), processes=processes)
    )


# -- the end ------------------------------------------------------------------------------------------------------------------


def test_it_waits_until_everybody_is_down(write) -> None:
    verdict = judged(write("  - at: uav1.airborne\n"))
    assert verdict.passed and verdict.ended == "all is done" and verdict.lasted_s == pytest.approx(DOWN_S)


def test_on_the_floor_but_armed_is_not_down(write) -> None:
    verdict = judged(write("  - at: uav1.airborne\n"), lambda t: flight(t, armed=True))
    assert (
        sentence(verdict) == "uav1 was on the floor and still armed, the time limit of 15 s came at 20.00 s"
    )


def test_still_in_the_air_at_the_time_limit(write) -> None:
    verdict = judged(write("  - at: uav1.airborne\n", time_limit_s=8))
    assert (
        sentence(verdict)
        == "uav1 was in the air in AUTO.LAND, 1.00 m above the floor, the time limit of 8 s came at 13.00 s"
    )
    assert judged(write("  - at: uav1.airborne\n", may=["stay up"], time_limit_s=8)).passed


def test_a_step_whose_moment_never_comes(write) -> None:
    verdict = judged(
        write("  - at: uav2.airborne + 3 s\n    do: land all\n  - expect: uav2.landed within 2 s\n")
    )
    assert (
        sentence(verdict) == "uav2.airborne + 3 s never came: the time limit of 15 s came first, at 20.00 s"
    )
    assert [s.outcome for s in verdict.steps] == ["failed", "not reached"]


def test_an_expectation_that_the_time_limit_cuts_off(write) -> None:
    verdict = judged(write("  - at: uav1.airborne\n  - expect: uav2.airborne within 20 s\n", time_limit_s=5))
    assert "uav2 was on the floor all the time" in sentence(
        verdict
    ) and "the time limit of 5 s came 4.00 s after" in sentence(verdict)


def test_an_arena_that_ends_by_itself(write) -> None:
    steps = "  - at: uav1.airborne\n    do: kill world\n  - expect: arena ended within 10 s\n"
    referee = write(steps, may=["stay up"])
    fly(referee, until=3.0)
    assert not referee.over
    referee.finish({"failed": ["world: killed by SIGKILL"]})
    assert referee.verdict().passed


def test_an_arena_that_was_ended_after_the_time_limit_has_not_ended_by_itself(write) -> None:
    assert not judged(
        write("  - at: uav1.airborne\n  - expect: arena ended within 100 s\n", may=["stay up"])
    ).passed


def test_an_arena_that_ends_too_early(write) -> None:
    verdict = judged(write("  - at: uav1.airborne\n  - expect: uav1.landed within 20 s\n"), until=3.0)
    assert "the end of the arena came 1.98 s after" in sentence(verdict)


def test_an_arena_that_did_not_come_up(write) -> None:
    referee = write("  - at: uav1.airborne\n", ["inside geofence"])
    referee.finish({}, "router: not ready after 30 s")
    verdict = referee.verdict()
    assert (None, "router: not ready after 30 s") in verdict.failures and not verdict.passed
    assert verdict.rules[0].outcome == "not reached"


# -- rules --------------------------------------------------------------------------------------------------------------------

FLOWN = "  - at: uav1.airborne\n"


def both(t: float, **more: Any) -> Mapping[str, Any]:
    """Both fly; uav2 comes near at 3 s, to 0.6 m."""
    aloft = 1.0 <= t < 6.0
    height = 1.0 if aloft else 0.0
    near = 1.6 if abs(t - 3.0) < 1e-6 else 3.0
    return {
        "uav1": uav("uav1", height, **more),
        "uav2": uav("uav2", height, **{"p_n": (near, 0.0, -height), **more}),
    }


BROKEN = {
    "separation > 0.8 m": (
        {},
        "separation between uav1 and uav2 was 0.60 m at 8.00 s; more than 0.80 m is asked",
    ),
    "uav1.tilt < 40 deg": (
        {"tilt_rad": math.radians(45)},
        "uav1.tilt was 45.00 deg at 6.00 s; less than 40.00 deg is asked",
    ),
    "each.speed < 1 m/s": (
        {"v_n": (0.0, 1.5, 0.0)},
        "uav1.speed was 1.50 m/s at 6.00 s; less than 1.00 m/s is asked",
    ),
    "uav2.battery > 90 %": ({}, "uav2.battery was 80.00 % at 6.00 s; more than 90.00 % is asked"),
    "not uav1.height > 0.9 m": ({}, "uav1.height was 1.00 m at 6.00 s; less than 0.90 m is asked"),
    "inside geofence": ({"p_n": (5.5, 0.0, -1.0)}, "uav1 was 0.50 m outside the geofence at 6.00 s"),
    "uav1.estimate error < 0.1 m": ({"est_p_n": (1.0, 0.2, -1.0)}, "uav1.estimate error was "),
    "tracking(uav1) < 0.1 m": ({"target_p_n": (1.0, 0.2, -1.0)}, "tracking(uav1) was 0.20 m at 6.00 s"),
    "tracking(uav1) < 0.1 m rms": (
        {"target_p_n": (1.0, 0.2, -1.0)},
        "tracking(uav1) was 0.20 m rms over its flight in OFFBOARD; less",
    ),
    "uav1.mode == OFFBOARD": ({}, "uav1.mode was AUTO.LOITER at 11.00 s; asked is uav1.mode == OFFBOARD"),
    "not each.crashed": ({"crashed": "hit the wall"}, "uav1 was crashed (hit the wall) at 6.00 s"),
    'not told "critical"': (
        {},
        '"critical" was told: Critical battery at 9.00 s; asked is not told "critical"',
    ),
    "router is READY": ({}, "router was BACKOFF at 7.00 s; asked is router is READY"),
    "uav1.touchdown < 0.1 m/s": (
        {"v_n": (0.0, 0.0, 0.4)},
        "uav1.touchdown was 0.40 m/s at 11.00 s; less than 0.10 m/s is asked",
    ),
}


def watched(referee: Referee, more: Mapping[str, Any]) -> Verdict:
    def processes(t: float) -> Mapping[str, str]:
        return {"router": "BACKOFF" if 2.0 <= t < 2.5 else "READY"}

    return judged(referee, lambda t: both(t, **more), events={4.0: "Critical battery"}, processes=processes)


@pytest.mark.parametrize("rule", BROKEN)
def test_a_broken_rule_is_told_by_its_worst(write, rule: str) -> None:
    more, told = BROKEN[rule]
    result = watched(write(FLOWN, [rule], may=["crash each"]), more).rules[0]
    assert result.outcome == "failed" and told in result.failure
    assert result.place.line == 9 and result.place.text == rule


KEPT = {
    "separation > 0.5 m": (0.6, "uav1 and uav2"),
    "uav1.tilt < 10 deg": (0.0, "uav1"),
    "each.speed < 1 m/s": (0.5, "uav1"),
    "uav2.battery > 70 %": (80.0, "uav2"),
    "inside geofence": (-2.0, "uav2"),
    "not each.crashed": (None, "uav1"),
    "tracking(uav2) < 1 m rms": (0.5, "uav2"),
    'not told "panic"': (None, ""),
    "uav1.height < 1.1 m": (1.0, "uav1"),
}


@pytest.mark.parametrize("rule", KEPT)
def test_a_kept_rule_tells_how_near_it_was(write, rule: str) -> None:
    def script(t: float) -> Mapping[str, Any]:
        made = both(t, v_n=(0.0, 0.5, 0.0))
        return {name: replace(v, target_p_n=(v.p_n[0], 0.5, v.p_n[2])) for name, v in made.items()}

    verdict = judged(write(FLOWN, [rule]), script)
    assert verdict.passed, verdict.failures
    worst, who = KEPT[rule]
    assert verdict.rules[0].outcome == "passed" and verdict.rules[0].who == who
    assert verdict.rules[0].worst == (None if worst is None else pytest.approx(worst))


def test_a_rule_holds_in_flight_alone(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return both(t, tilt_rad=1.0 if t < 0.5 or t > 6.5 else 0.1)

    steps = "  - at: start + 8 s\n"
    assert judged(write(steps, ["each.tilt < 40 deg"]), script).passed


def test_one_on_the_floor_is_not_judged_while_another_flies(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return {**flight(t), "uav2": uav("uav2", tilt_rad=1.0, p_n=(9.0, 0.0, 0.0))}

    verdict = judged(write(FLOWN, ["each.tilt < 40 deg", "inside geofence"]), script)
    assert verdict.passed and verdict.rules[0].who == "uav1"


def test_the_root_mean_square_is_over_offboard_alone(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        off = 0.3 if 2.0 <= t < 4.0 else 0.1
        mode = "AUTO.LAND" if t >= 5.0 else "OFFBOARD"
        return both(t, mode=mode, target_p_n=(1.0, 9.0 if t >= 5.0 else off, -1.0))

    rule = judged(write(FLOWN, ["tracking(uav1) < 1 m rms"]), script).rules[0]
    assert rule.worst == pytest.approx(math.sqrt((0.3**2 + 0.1**2) / 2), rel=1e-2) and rule.unit == "m"


def test_a_rule_that_nothing_was_seen_of_fails(write) -> None:
    told = sentence(judged(write(FLOWN, ["tracking(uav1) < 1 m rms"])))
    assert (
        told
        == "nothing was seen to judge it by: no setpoint of a position was heard in OFFBOARD and in the air"
    )
    assert "nobody took off" in sentence(judged(write("  - at: start\n", ["inside geofence"])))


def test_unknown_does_not_break_a_rule(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return both(t, battery=None if t > 3.0 else 0.5)

    rule = judged(write(FLOWN, ["each.battery > 40 %"]), script).rules[0]
    assert rule.outcome == "passed" and rule.worst == pytest.approx(50.0)


# -- what holds though nobody wrote it ----------------------------------------------------------------------------------------


def test_nobody_crashes(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return flight(t, crashed="hit the wall" if t > 3.0 else "")

    assert sentence(judged(write(FLOWN), script)) == "uav1 crashed: hit the wall"
    assert judged(write(FLOWN, may=["crash uav1"]), script).passed
    assert not judged(write(FLOWN, may=["crash uav2"]), script).passed


def test_a_crash_that_only_the_supervisor_saw(write) -> None:
    outcome = {"failed": ["uav1 crashed: 12.1 s: tilt 70 deg"]}
    assert sentence(judged(write(FLOWN), outcome=outcome)) == "uav1 crashed: 12.1 s: tilt 70 deg"
    assert judged(write(FLOWN, may=["crash each"]), outcome=outcome).passed


def test_one_that_has_crashed_and_lies_there_is_not_waited_for(write) -> None:
    verdict = judged(
        write(FLOWN, may=["crash uav1"]),
        lambda t: flight(t, armed=True, crashed="hit the wall" if t > 3.0 else ""),
    )
    assert verdict.passed and verdict.lasted_s == pytest.approx(DOWN_S)


def test_no_process_fails_but_those_that_were_hit_or_may(write) -> None:
    outcome = {"failed": ["program.uav1: killed by SIGKILL", "the landing was not confirmed"]}
    told = sentence(judged(write(FLOWN), outcome=outcome))
    assert told == "program.uav1: killed by SIGKILL (where that is meant, write `may: [fail program.uav1]`)"
    assert judged(write(FLOWN, may=["fail program.uav1"]), outcome=outcome).passed
    assert judged(write(FLOWN + "    do: kill program uav1\n"), outcome=outcome).passed
    assert judged(write(FLOWN, may=["fail program uav1"]), outcome=outcome).passed
    assert not judged(write(FLOWN + "    do: kill router\n"), outcome=outcome).passed


def test_a_deed_that_was_not_reached_excuses_nothing(write) -> None:
    steps = FLOWN + "    expect: uav2.airborne within 1 s\n  - do: kill program uav1\n"
    verdict = judged(write(steps), outcome={"failed": ["program.uav1: ended with code 1"]})
    assert any(told.startswith("program.uav1: ended with code 1") for _, told in verdict.failures)


def test_a_process_that_is_given_up_while_it_flies(write) -> None:
    verdict = judged(write(FLOWN), processes=lambda t: {"logger.uav1": "FATAL" if t > 3.0 else "READY"})
    assert sentence(verdict).startswith("logger.uav1: is FATAL")


def test_any_other_failure_of_the_arena_fails_the_scenario(write) -> None:
    assert sentence(judged(write(FLOWN), outcome={"failed": ["the disk is full"]})) == "the disk is full"


def test_the_default_rules_are_told_at_the_scenario(write) -> None:
    places = [rule.place for rule in judged(write(FLOWN)).rules]
    assert [p.text for p in places] == [
        "nobody crashes",
        "everybody has landed at the end",
        "no process fails",
    ]
    assert {(p.file, p.line) for p in places} == {("s.yaml", 1)}


# -- figures ------------------------------------------------------------------------------------------------------------------


def test_touchdown_time_speed_and_drift_count_from_the_last_deed(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        aside = 0.1 * max(0.0, min(t, DOWN_S) - 4.0)
        return flight(t, p_n=(1.0, aside, -1.0), v_n=(0.0, 0.1, 0.7))

    (touchdown,) = judged(
        write("  - at: uav1.airborne + 3 s\n    do: kill program uav1\n"), script
    ).touchdowns
    assert touchdown.vehicle == "uav1" and touchdown.at_s == pytest.approx(START_S + DOWN_S)
    assert touchdown.after_s == pytest.approx(6.0) and touchdown.drift_m == pytest.approx(0.6)
    assert touchdown.speed_m_s == pytest.approx(math.hypot(0.1, 0.7))


def test_without_a_deed_there_is_no_time_since_it_and_no_drift(write) -> None:
    (touchdown,) = judged(write(FLOWN)).touchdowns
    assert touchdown.after_s is None and touchdown.drift_m is None


def test_a_bounce_is_no_further_touchdown(write) -> None:
    def script(t: float) -> Mapping[str, Any]:
        bounces = 10.1 <= t < 10.2
        return {"uav1": uav("uav1", 0.02, v_n=(0.0, 0.0, 0.1))} if bounces else flight(t, v_n=(0.0, 0.0, 0.7))

    (touchdown,) = judged(write("  - at: start + 12 s\n"), script).touchdowns
    assert touchdown.at_s == pytest.approx(START_S + DOWN_S) and touchdown.speed_m_s == pytest.approx(0.7)


def test_ten_rows_a_second_are_kept_of_each_vehicle(write) -> None:
    referee = write(FLOWN)
    judged(referee, both)
    own = [row for row in referee.rows if row.vehicle == "uav1"]
    assert len(own) == 61 and len(referee.rows) == 122
    assert min(row.nearest_m for row in own if row.nearest_m is not None) == pytest.approx(0.6)
    assert own[0].nearest_m is None and own[20].nearest_m == pytest.approx(2.0)


def test_the_same_looks_give_the_same_verdict(write) -> None:
    steps = "  - at: uav1.airborne + 1 s\n    do: kill program uav1\n  - expect: each.landed within 9 s\n"
    verdicts = [watched(write(steps, list(BROKEN)), {"v_n": (0.0, 0.0, 1.5)}) for _ in range(2)]
    assert verdicts[0] == verdicts[1]


# -- whatever is seen ---------------------------------------------------------------------------------------------------------

number = st.one_of(st.floats(-5.0, 5.0), st.just(math.nan))
vector = st.tuples(number, number, number)


@st.composite
def anything(draw, name: str) -> VehicleNow:
    return VehicleNow(
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


looks = st.lists(
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


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(looks, st.sampled_from(["", "router: not ready"]))
def test_whatever_is_seen_there_is_a_verdict_that_can_be_told_and_is_the_same_again(
    write, seen, trouble: str
) -> None:
    def verdict() -> Verdict:
        referee, now = write(STEPS, list(BROKEN)), 0.0
        for wait, vehicles, events, state in seen:
            now += wait
            if not referee.over:
                processes = {"program.uav1": state} if state else {}
                referee.look(
                    Now(
                        time_s=now, vehicles={v.name: v for v in vehicles}, events=events, processes=processes
                    )
                )
        referee.finish({"failed": ["program.uav1: exit 1"]}, trouble)
        return referee.verdict()

    first = verdict()
    result = Result(scenario="s", file="s.yaml", seed=1, verdict=first)
    assert first.passed == (not reasons(result))
    assert results_json([result]) == results_json(
        [replace(result, verdict=verdict())]
    )  # NaN is not equal to itself, its text is
    assert ElementTree.fromstring(junit_xml([result])).find(".//testcase") is not None
    assert story(result)
