"""Results as a table, JUnit XML, JSON and plots."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from xml.etree import ElementTree

from rich.console import Console

from arena.smoke import report
from arena.smoke.language.model import Place
from arena.smoke.referee.verdict import Result, RuleResult, StepResult, Touchdown, Verdict


def place(line: int, text: str) -> Place:
    return Place(file="loss.yaml", line=line, text=text)


PASSED = Result(
    scenario="offboard loss lands [one]",
    file="loss.yaml",
    seed=3,
    run="runs/1-one",
    wall_s=4.25,
    facts={"autopilot": "builtin"},
    verdict=Verdict(
        steps=(
            StepResult(
                place=place(4, "at uav1.airborne + 3 s: kill program uav1"),
                outcome="passed",
                kind="do",
                begun_s=6.0,
                done_s=6.0,
            ),
            StepResult(
                place=place(6, "uav1.mode == LAND within 2 s"), outcome="passed", begun_s=6.0, done_s=7.125
            ),
        ),
        rules=(
            RuleResult(
                place=place(9, "separation > 0.8 m"),
                outcome="passed",
                worst=1.25,
                unit="m",
                at_s=6.5,
                who="uav1 and uav2",
            ),
        ),
        touchdowns=(Touchdown(vehicle="uav1", at_s=9.5, after_s=3.5, speed_m_s=0.625, drift_m=0.125),),
        lasted_s=10.5,
        ended="all is done",
    ),
)
BROKEN = replace(
    PASSED,
    scenario="loss <& [bold]$four^[/] $_",
    report="runs/2/report.html",
    verdict=replace(
        PASSED.verdict,
        steps=(
            PASSED.verdict.steps[0],
            replace(
                PASSED.verdict.steps[1],
                outcome="failed",
                done_s=None,
                failure="uav1.mode was OFFBOARD \x1b[0m",
            ),
        ),
        rules=(
            replace(
                PASSED.verdict.rules[0],
                outcome="failed",
                worst=0.61,
                failure="separation between uav1 and uav2 was 0.61 m at 6.50 s",
            ),
        ),
        problems=("router: <gone>",),
        ended="a step failed",
    ),
)
BOTH = (PASSED, BROKEN)


def shown(results: tuple[Result, ...]) -> str:
    console = Console(file=io.StringIO(), width=240)
    console.print(report.table(results))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_table_has_a_row_per_scenario_and_every_failure() -> None:
    text = shown(BOTH)
    assert (
        "offboard loss lands [one]" in text
        and "1.12 s: uav1.mode == LAND within 2 s" in text
        and "0.62" in text
    )
    assert "flown [s]" in text
    assert "loss <& [bold]$four^[/] $_" in text  # a name is no markup
    for line in (
        "loss.yaml:6: uav1.mode was OFFBOARD",
        "loss.yaml:9: separation between uav1 and uav2 was 0.61 m",
        "router: <gone>",
    ):
        assert line in text
    assert shown((PASSED,)).count("\n") == 2


def test_table_names_the_failed_step_and_not_a_passed_one() -> None:
    failed = StepResult(
        place=place(9, "uav1.landed within 0.5 s"),
        outcome="failed",
        begun_s=8.0,
        failed_s=8.5,
        failure="in the air",
    )
    verdict = replace(PASSED.verdict, steps=(*PASSED.verdict.steps, failed))
    row = shown((replace(PASSED, verdict=verdict),)).splitlines()[1]
    assert "FAILED: uav1.landed within 0.5 s" in row and "uav1.mode == LAND within 2 s" not in row


def test_summary_counts_scenarios() -> None:
    assert report.summary(BOTH) == "2 scenarios, 1 failed; 21 s of simulation"
    assert report.summary(BOTH[:1]) == "1 scenario, all passed; 10 s of simulation"


def test_junit_has_a_testcase_per_scenario() -> None:
    root = ElementTree.fromstring(report.junit_xml(BOTH))
    assert root.tag == "testsuites"
    (suite,) = root
    assert (suite.tag, suite.get("tests"), suite.get("failures"), suite.get("errors")) == (
        "testsuite",
        "2",
        "1",
        "0",
    )
    passed, failed = suite
    assert [c.tag for c in passed] == ["system-out"] and [c.tag for c in failed] == ["failure", "system-out"]
    assert (
        passed.get("name") == PASSED.scenario
        and passed.get("classname") == "smoke.loss"
        and passed.get("time") == "4.250"
    )
    assert failed.get("name") == BROKEN.scenario
    assert (failed.get("file"), failed.get("line")) == ("loss.yaml", "6")
    failure = failed[0]
    assert failure.get("message", "").startswith("loss.yaml:6: uav1.mode was OFFBOARD")
    assert (failure.text or "").splitlines() == [
        "loss.yaml:6: uav1.mode was OFFBOARD ?[0m",
        "loss.yaml:9: separation between uav1 and uav2 was 0.61 m at 6.50 s",
        "router: <gone>",
    ]


def test_junit_has_an_error_per_interrupted_scenario() -> None:
    root = ElementTree.fromstring(report.junit_xml(BOTH, ["c", "d\x01"]))
    assert (root.get("tests"), root.get("errors")) == ("4", "2")
    assert [case.get("name") for case in root.iter("testcase") if case.find("error") is not None] == [
        "c",
        "d?",
    ]


def test_junit_lists_the_steps() -> None:
    out = ElementTree.fromstring(report.junit_xml((PASSED,))).find(".//system-out")
    assert out is not None and (out.text or "").splitlines() == [
        "seed 3, 10.50 s of simulation, over: all is done",
        "run folder runs/1-one",
        "passed      at uav1.airborne + 3 s: kill program uav1 at 6.00 s",
        "passed      uav1.mode == LAND within 2 s after 1.12 s, at 7.12 s",
        "passed      separation > 0.8 m (worst: 1.25 m, uav1 and uav2 at 6.50 s)",
        "uav1 came down at 9.50 s, 3.50 s after the last action, at 0.62 m/s, 0.12 m aside",
    ]


def test_every_failed_result_has_a_reason() -> None:
    step = replace(PASSED.verdict.steps[0], outcome="not reached", begun_s=None, done_s=None)
    bare = replace(PASSED, verdict=Verdict(steps=(step,), rules=(), ended="the time limit"))
    assert not bare.verdict.passed and report.reasons(bare) == [
        "loss.yaml: not all steps were reached: the time limit"
    ]
    assert ElementTree.fromstring(report.junit_xml((bare,))).find(".//failure") is not None


def test_results_are_read_back_equal() -> None:
    text = report.results_json(BOTH)
    assert report.read_results(text) == list(BOTH)
    assert [one["passed"] for one in json.loads(text)] == [True, False]
