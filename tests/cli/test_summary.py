"""The verdict and the short table of a run, from the files of its run folder; the verbs `summary` and `runs`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import arena.cli as cli
from arena.cli._summary import lines_of, verdict


def vehicle(**changes: Any) -> dict[str, Any]:
    known = {
        "flown": True,
        "crashed": "",
        "landing": {"landed": True},
        "tracking": {"rms_m": 0.4518},
        "battery_end": 97.0,
        "in_air_s": 27.9,
        "verdict": {"airborne_s": 28.15, "max_height_m": 1.676},
    }
    return {**known, **changes}


def make_run(
    folder: Path, vehicles: dict[str, Any] | None = None, events: Sequence[Any] = (), **changes: Any
) -> Path:
    """Write a run folder as the supervisor and the report leave it."""
    run = folder / "runs" / "20261122-101500-lab"
    run.mkdir(parents=True)
    outcome = {
        "name": "lab",
        "start": "2026-11-22T10:15:00.000+00:00",
        "duration_s": 20.44,
        "exit_code": 0,
        "failed": [],
        "landing": "no vehicle had to be landed",
        "real_time": {"factor": 0.997, "asked": 1.0},
        **changes,
    }
    (run / "plan.json").write_text(json.dumps({"name": "lab"}))
    (run / "outcome.json").write_text(json.dumps(outcome))
    (run / "events.jsonl").write_text("".join(json.dumps(e) + "\n" for e in events))
    if vehicles is not None:
        (run / "summary.json").write_text(json.dumps({"vehicles": vehicles}))
        (run / "summary.txt").write_text("everything the report found\n")
    return run


def test_verdict_of_a_good_run_names_who_landed(tmp_path: Path) -> None:
    run = make_run(tmp_path, {"uav1": vehicle(), "uav2": vehicle()})
    assert verdict(run) == "lab: succeeded after 20.4 s: uav1, uav2 landed"


def test_verdict_of_a_failed_run_has_every_failure(tmp_path: Path) -> None:
    run = make_run(
        tmp_path,
        {"uav1": vehicle()},
        exit_code=1,
        failed=["program.uav1: exit 1", "uav2 crashed: hit a wall"],
    )
    assert verdict(run) == "lab: FAILED after 20.4 s: program.uav1: exit 1; uav2 crashed: hit a wall"


def test_verdict_after_ctrl_c_without_a_report_has_the_landing(tmp_path: Path) -> None:
    run = make_run(tmp_path, exit_code=130, landing="landed and disarmed")
    assert verdict(run) == "lab: interrupted by Ctrl-C after 20.4 s: landed and disarmed"


def test_verdict_has_the_failsafe_text_of_the_autopilot(tmp_path: Path) -> None:
    text = "uav1: Failsafe activated: no offboard setpoints: AUTO.LAND"
    events = [{"process": "router", "event": text}, {"process": "p", "event": "uav1: my own failsafe"}]
    run = make_run(tmp_path, {"uav1": vehicle()}, events)
    assert verdict(run) == f"lab: succeeded after 20.4 s: uav1 landed; {text}"


@pytest.mark.parametrize(("asked", "slow"), [(1.0, True), (None, False), (0.65, False)])
def test_verdict_says_that_a_flight_was_slower_than_asked(
    tmp_path: Path, asked: float | None, slow: bool
) -> None:
    run = make_run(tmp_path, {"uav1": vehicle()}, real_time={"factor": 0.65, "asked": asked})
    assert ("SLOWER THAN REQUESTED: 0.65 simulated seconds per second" in verdict(run)) is slow


def test_verdict_without_an_outcome_says_so(tmp_path: Path) -> None:
    run = make_run(tmp_path)
    (run / "outcome.json").unlink()
    assert verdict(run).endswith("no outcome was recorded: the supervisor was killed, or could not write it")


def test_verdict_of_a_run_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    run = make_run(tmp_path, real_time=None)
    assert verdict(run) == "lab: succeeded after 20.4 s: no vehicle had to be landed"


def test_short_table_has_a_row_per_vehicle(tmp_path: Path) -> None:
    bad = vehicle(crashed="touched a wall", tracking=None, battery_end=None, in_air_s=None, verdict=None)
    run = make_run(tmp_path, {"uav1": vehicle(), "uav2": bad, "uav3": vehicle(flown=False)})
    rows = [line.split() for line in lines_of(run)[2:]]
    assert rows[0] == ["uav1", "27.9", "1.68", "0.452", "97", "landed"]
    assert rows[1] == ["uav2", "-", "-", "-", "-", "crashed", "(touched", "a", "wall)"]
    assert rows[2][-3:] == ["did", "not", "fly"]


def run_cli(*arguments: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = cli.main(arguments)
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def test_summary_prints_the_verdict_and_the_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = make_run(tmp_path, {"uav1": vehicle()})
    code, out, _ = run_cli("summary", str(run), capsys=capsys)
    assert code == 0 and out.startswith("lab: succeeded") and out.endswith("everything the report found\n")
    code, out, _ = run_cli("summary", str(run), "--json", capsys=capsys)
    assert code == 0 and list(json.loads(out)["vehicles"]) == ["uav1"]


def test_summary_without_a_report_names_the_command_that_makes_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = run_cli("summary", str(make_run(tmp_path)), capsys=capsys)
    assert code == 2 and "arena report" in err
    (tmp_path / "other").mkdir()
    code, _, err = run_cli("summary", str(tmp_path / "other"), capsys=capsys)
    assert code == 2 and "not a run folder" in err


@pytest.mark.parametrize(
    ("changes", "result"),
    [
        ({}, "succeeded"),
        ({"exit_code": 1, "failed": ["p: exit 3", "q: exit 1"]}, "failed: p: exit 3"),
        ({"exit_code": 130}, "interrupted"),
    ],
)
def test_runs_lists_time_name_result_and_folder(
    changes: dict[str, Any],
    result: str,
    tmp_path: Path,
    runtime_dir: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    make_run(tmp_path, **changes)
    code, out, _ = run_cli("runs", capsys=capsys)
    assert code == 0
    (line,) = out.splitlines()[1:]
    assert line.split() == ["2026-11-22", "10:15:00", "lab", *result.split(), "runs/20261122-101500-lab"]


def test_runs_without_an_outcome_and_without_runs(
    tmp_path: Path, runtime_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = make_run(tmp_path)
    (run / "outcome.json").unlink()
    assert "no outcome was recorded" in run_cli("runs", str(tmp_path), capsys=capsys)[1]
    (tmp_path / "empty").mkdir()
    assert run_cli("runs", str(tmp_path / "empty"), capsys=capsys)[1].startswith("no run folders in ")
