"""PX4s in a whole run: end of the run, its result, and the summary."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from arena.plan import Plan, make_plan
from arena.report.run_report import report
from arena.schema import load_arena
from arena.supervisor.process_state import Exit, ProcessStatus, State
from arena.supervisor.run_end import Cause, End, failures, grounded, is_done, may_fly

READY = ProcessStatus(state=State.READY, started=1)
DONE = ProcessStatus(state=State.EXITED, started=1, exit=Exit(code=0, text="exit 0"))
DIED = ProcessStatus(state=State.EXITED, started=1, reason="exit 1", exit=Exit(code=1, text="exit 1"))


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    """uav1 and uav2 fly PX4, uav3 the built-in autopilot."""
    file = tmp_path / "arena.yaml"
    file.write_text(
        "px4: {home: stand-in}\nvehicles: {uav1: {autopilot: px4}, uav2: {autopilot: px4, start: {position: [1, 0, 0]}},"
        " uav3: {autopilot: builtin, start: {position: [2, 0, 0]}}}\n"
    )
    return make_plan(load_arena(file))


def lives_of(plan: Plan, **others: ProcessStatus) -> dict[str, ProcessStatus]:
    return {**{p.name: READY for p in plan.processes}, **{k.replace("_", "."): v for k, v in others.items()}}


def test_a_vehicle_whose_px4_ended_counts_as_grounded(plan: Plan) -> None:
    armed = {f"uav{k}.armed": True for k in (1, 2, 3)}
    lives = lives_of(plan, px4_uav1=DIED)
    assert grounded(plan, lives) == {"uav1": "its PX4 has ended"}
    assert may_fly(plan, lives, armed, armed) == ["uav2", "uav3"]
    assert may_fly(plan, lives_of(plan), armed, armed) == ["uav1", "uav2", "uav3"]


def test_a_run_ends_though_a_killed_px4_never_disarmed(plan: Plan) -> None:
    facts = {"uav1.armed": True, "uav2.armed": False, "uav3.armed": False}
    assert not is_done(plan, lives_of(plan), facts)
    assert is_done(plan, lives_of(plan, px4_uav1=DIED), facts)
    assert not is_done(plan, lives_of(plan, px4_uav2=DIED), facts)
    assert is_done(plan, lives_of(plan, px4_uav1=DIED), {"uav2.armed": False, "uav3.armed": False})


def test_a_px4_that_ended_early_fails_the_run(
    plan: Plan,
) -> None:
    def failed(then: ProcessStatus) -> list[str]:
        lives = lives_of(plan, px4_uav1=then)
        end = End(cause=Cause.DONE, why="done", statuses=lives)
        return failures(
            plan, end, {**lives, **{p.name: DONE for p in plan.processes}}, {}, landed=True, until_done=True
        )

    assert failed(DIED) == ["px4.uav1: exit 1"]
    assert failed(READY) == []


def write_run(folder: Path, plan: Plan, ended: str) -> Path:
    """Write the files of a run that the report reads about PX4: two flew it, one wrote a log."""
    (folder / "px4/uav1/log/2026-01-02").mkdir(parents=True)
    (folder / "px4/uav1/log/2026-01-02/10_11_12.ulg").write_bytes(b"ULog")
    (folder / "px4/uav1/log/data.txt").touch()
    (folder / "plan.json").write_text(plan.to_json())
    row: dict[str, Any] = {
        "state": "EXITED",
        "cpu_mean": 0.1,
        "rss_peak_mb": 30.0,
        "starts": 1,
        "exit": "exit 1",
    }
    processes = {"px4.uav1": {**row, "stats": {"ended": ended} if ended else {}}, "px4.uav2": row}
    outcome = {
        "name": "lab",
        "exit_code": 1,
        "failed": [],
        "reason": "done",
        "duration_s": 1.0,
        "processes": processes,
    }
    (folder / "outcome.json").write_text(json.dumps(outcome))
    return folder


def test_summary_names_px4_its_logs_and_its_end(plan: Plan, tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", plan, "killed by SIGKILL")
    text = report(run)
    assert "uav1: arena's stand-in for PX4 ENDED BY ITSELF (killed by SIGKILL); ULogs: ulog/uav1.ulg" in text
    assert "uav2: arena's stand-in for PX4; ULogs: none" in text and "uav3: arena" not in text
    found = json.loads((run / "summary.json").read_text())["px4"]
    assert found["uav1"] == {
        "version": "",
        "stand_in": True,
        "ended": "killed by SIGKILL",
        "ulogs": ["ulog/uav1.ulg"],
    }
    assert set(found) == {"uav1", "uav2"} and found["uav2"]["ended"] == ""


def test_summary_has_the_version_of_a_real_px4(plan: Plan, tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", plan, "")
    whole = json.loads((run / "plan.json").read_text())
    whole["slices"]["px4.uav1.json"] |= {"version": "1.16.0", "stand_in": False}
    (run / "plan.json").write_text(json.dumps(whole))
    assert "uav1: PX4 1.16.0; ULogs: ulog/uav1.ulg" in report(run)


def test_report_gives_the_logs_of_px4_a_name_in_the_folder_ulog(plan: Plan, tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", plan, "")
    (run / "px4/uav1/log/2026-01-02/10_20_00.ulg").write_bytes(b"ULog2")
    for _ in range(2):
        report(run)
    assert {p.name: p.read_bytes() for p in (run / "ulog").iterdir()} == {
        "uav1.ulg": b"ULog",
        "uav1_2.ulg": b"ULog2",
    }
    assert (run / "ulog/uav1.ulg").stat().st_ino == (
        run / "px4/uav1/log/2026-01-02/10_11_12.ulg"
    ).stat().st_ino


def test_logs_are_copied_where_hard_links_are_not_possible(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: Path, target: Path) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    run = write_run(tmp_path / "run", plan, "")
    report(run)
    assert (run / "ulog/uav1.ulg").read_bytes() == b"ULog"
