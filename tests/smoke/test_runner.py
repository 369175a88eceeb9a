"""The runner of several scenarios and `arena smoke`, with fakes in place of flights."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from arena.cli import main
from arena.cli.smoke import files, load
from arena.errors import InputError, RunError
from arena.smoke.flying import runner
from arena.smoke.flying.fly_scenario import FlightOptions, slug
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.verdict import Result, Verdict

ROOT = Path(__file__).parents[2]
ARENA = "vehicles:\n  uav1: {autopilot: builtin}\n"
STEPS = "steps:\n  - expect: uav1.airborne within 20 s\n"


@pytest.fixture
def options(tmp_path: Path) -> FlightOptions:
    return FlightOptions(results=tmp_path / "results")


def scenarios(folder: Path, *names: str) -> list[Scenario]:
    (folder / "arena.yaml").write_text(ARENA)
    for name in names:
        (folder / f"{name}.smoke.yaml").write_text(f"name: {name}\narena: arena.yaml\n{STEPS}")
    return load([folder / f"{name}.smoke.yaml" for name in names], [])


def passed(scenario: Scenario, options: FlightOptions) -> Result:
    verdict = Verdict(steps=(), rules=(), ended=f"in {os.getpid()}")
    return Result(scenario=scenario.name, file=scenario.place.file, seed=options.seed or 1, verdict=verdict)


def test_results_keep_the_order_of_the_scenarios(tmp_path: Path, options: FlightOptions):
    reported: list[str] = []
    found = runner.fly_all(
        scenarios(tmp_path, "c", "a", "b"),
        options,
        jobs=2,
        on_result=lambda r: reported.append(r.scenario),
        flown_by=passed,
    )
    assert [r.scenario for r in found] == ["c", "a", "b"] and sorted(reported) == ["a", "b", "c"]
    assert len({r.verdict.ended for r in found} | {f"in {os.getpid()}"}) == 4


def test_longest_flights_begin_first(tmp_path: Path, options: FlightOptions):
    """Else the longest flight can be the last, which keeps one core busy while the others wait."""
    given = scenarios(tmp_path, "short", "long", "longer")
    begun: list[str] = []
    runner.fly_all(
        [replace(s, time_limit_s=limit) for s, limit in zip(given, (30.0, 60.0, 90.0), strict=True)],
        options,
        jobs=1,
        on_result=lambda result: begun.append(result.scenario),
        flown_by=passed,
    )
    assert begun == ["longer", "long", "short"]


def test_failed_flight_does_not_affect_others(tmp_path: Path, options: FlightOptions):
    def fly(scenario: Scenario, options: FlightOptions) -> Result:
        if scenario.name == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if scenario.name == "wrong":
            raise RunError("no run folder")
        return passed(scenario, options)

    killed, wrong, right = runner.fly_all(
        scenarios(tmp_path, "killed", "wrong", "right"),
        options,
        jobs=1,
        on_result=lambda _: None,
        flown_by=fly,
    )
    assert right.verdict.passed and wrong.verdict.problems == ("no run folder",)
    assert "ended without a result" in killed.verdict.problems[0]


def test_interruption_ends_every_worker_and_starts_none(tmp_path: Path, options: FlightOptions):
    def fly(scenario: Scenario, options: FlightOptions) -> Result:
        if scenario.name == "first":
            return passed(scenario, options)
        (tmp_path / f"{scenario.name}-began").touch()
        try:
            if scenario.name == "long":
                os.kill(os.getppid(), signal.SIGINT)
            while True:
                signal.pause()
        except KeyboardInterrupt:
            (tmp_path / f"{scenario.name}-landed").touch()
            raise

    given = scenarios(tmp_path, "first", "long", "never")
    with pytest.raises(runner.Interrupted) as interrupted:
        runner.fly_all(given, options, jobs=1, on_result=lambda _: None, flown_by=fly)
    assert [r.scenario for r in interrupted.value.results] == ["first"]
    assert (tmp_path / "long-landed").exists() and not (tmp_path / "never-began").exists()


# -- the command


def test_folder_stands_for_its_scenarios(tmp_path: Path):
    inner = tmp_path / "inner"
    inner.mkdir()
    scenarios(inner, "b", "a")
    assert files([tmp_path, inner / "a.smoke.yaml", inner / "arena.yaml"]) == [
        inner / "a.smoke.yaml",
        inner / "b.smoke.yaml",
        inner / "arena.yaml",
    ]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"empty: no \*\.smoke\.yaml"):
        files([tmp_path / "empty"])


def test_all_problems_are_reported_before_any_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
):
    monkeypatch.setattr(runner, "fly_all", None)
    scenarios(tmp_path, "good")
    (tmp_path / "one.smoke.yaml").write_text(
        "arena: arena.yaml\nsteps:\n  - expect: uav7.airborne within 2 s\n"
    )
    (tmp_path / "two.smoke.yaml").write_text(f"arena: arena.yaml\n{STEPS}  - do: kil program uav1\n")
    assert main(["smoke", str(tmp_path)]) == 2
    expected_text = capsys.readouterr().err
    assert f"{tmp_path}/one.smoke.yaml:3" in expected_text and f"{tmp_path}/two.smoke.yaml:4" in expected_text


@pytest.mark.parametrize(("passes", "code"), [(True, 0), (False, 1)])
def test_exit_code_and_files_show_the_result(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    passes: bool,
    code: int,
):
    def fly_all(given: list[Scenario], options: FlightOptions, **_: Any) -> list[Result]:
        assert options.seed == 7 and [s.arena.world.wind_m_s[0] for s in given] == [1.0, 1.0]
        verdict = Verdict(steps=(), rules=(), problems=() if passes else ("it fell",))
        return [Result(scenario=s.name, file=s.place.file, seed=7, verdict=verdict) for s in given]

    monkeypatch.setattr(runner, "fly_all", fly_all)
    scenarios(tmp_path, "good")
    junit, results = tmp_path / "out" / "junit.xml", tmp_path / "results"
    given = ["smoke", str(tmp_path), "--repeat", "2", "--seed", "7", "--set", "world.wind_m_s=[1, 0, 0]"]
    assert main([*given, "--junit", str(junit), "--results", str(results)]) == code
    assert 'tests="2"' in junit.read_text() and (results / "results.json").exists()
    assert ("it fell" in capsys.readouterr().out) is not passes


@pytest.mark.parametrize(
    ("option", "value", "expected_text"),
    [
        ("--speed", "fast", "--speed: got fast"),
        ("--speed", "0", "--speed: got 0"),
        ("--seed", "-4", "seed: got -4"),
        ("--junit", ".", "is a folder, expected a file"),
        ("--results", "s.py", "s.py: cannot be created"),
    ],
)
def test_options_are_checked_before_any_flight(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    option: str,
    value: str,
    expected_text: str,
):
    monkeypatch.setattr(runner, "fly_all", None)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.py").touch()
    scenarios(tmp_path, "good")
    assert main(["smoke", str(tmp_path), option, value]) == 2
    assert expected_text in capsys.readouterr().err


def test_list_flies_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(runner, "fly_all", None)
    scenarios(tmp_path, "a", "b")
    assert main(["smoke", str(tmp_path), "--list"]) == 0
    assert [line.rpartition(": ")[2] for line in capsys.readouterr().out.splitlines()] == ["a", "b"]


def test_shipped_scenarios_are_valid():
    found = load(files([ROOT / "examples"]), ["defaults.autopilot=builtin"])
    assert {"hover [one]", "hover [four]", "offboard loss lands"} <= {s.name for s in found}


@pytest.mark.parametrize(
    ("name", "folder"), [("offboard loss lands [four]", "offboard-loss-lands-four"), ("../..", "scenario")]
)
def test_name_becomes_a_folder(name: str, folder: str):
    assert slug(name) == folder


def test_unused_plugin_imports_nothing():
    code = (
        "import sys, pytest; before = set(sys.modules); import arena.smoke.plugin; "
        "print(*sorted(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {"arena", "arena.smoke", "arena.smoke.plugin"}
