"""A campaign with real arenas: killed in its second flight, then resumed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from end_to_end.flight import PATIENCE, eventually, started_by

from arena.campaign.store import Store

PROGRAM = """\
from arena import UAV

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    uav.set_pos_yaw(uav.ekf.pos + [0.0, 0.0, -1.0], 0.0, 4.0)
    uav.auto_land()
"""
SWEEP = "name: short\narena: arena.yaml\nvary: {wind: {values: [0, 1], set: 'world.wind_m_s=[{}, 0, 0]'}}\n"


def campaign(folder: Path, temporary: Path) -> subprocess.Popen[bytes]:
    """Start `arena campaign` as a user starts it."""
    with (folder / "out.txt").open("ab") as out:
        return subprocess.Popen(
            [sys.executable, "-m", "arena.cli", "campaign", "sweep.yaml", "-j", "1", "--results", "results"],
            stdout=out,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(temporary)},
            start_new_session=True,
        )


@pytest.mark.flight
def test_killed_campaign_is_resumed_without_the_flown_flights(tmp_path: Path, runtime_dir: Path) -> None:
    (tmp_path / "arena.yaml").write_text(
        "defaults: {autopilot: builtin}\nvehicles: {uav1: {program: hover.py}}\n"
    )
    (tmp_path / "hover.py").write_text(PROGRAM)
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    results = tmp_path / "results"

    def said() -> str:
        return (tmp_path / "out.txt").read_text()

    def runs() -> list[Path]:
        return [path.parent for path in results.glob("flights/*/*/plan.json")]

    first = campaign(tmp_path, runtime_dir)
    try:
        eventually(lambda: len(runs()) == 2, 120, "the second flight begins", said)
        before = Store(results).records()
    finally:
        first.kill()
        first.wait()
    assert [r.number for r in before.values()] == [1], said()
    eventually(lambda: not any(started_by(run) for run in runs()), 60, "the arena in the air ends", said)

    second = campaign(tmp_path, runtime_dir)
    try:
        assert second.wait(PATIENCE * 120) == 0, said()
    finally:
        second.kill()
        second.wait()
    lines = [json.loads(line) for line in (results / "results.jsonl").read_text().splitlines()]
    assert [(one["number"], one["passed"]) for one in lines] == [(1, True), (2, True)], said()
    assert "2 flights, 1 of them flown before" in said()
    for one in lines:
        measures = one["measures"]
        assert measures["crashes"] == 0 and measures["airborne_s"] > 2 and measures["landing_error_m"] < 0.3
        assert measures["tracking_rms_m"] is not None and (results / one["run"] / "outcome.json").is_file()
    assert (results / "results.parquet").is_file()
    assert not any(started_by(run) for run in runs())
