"""Campaigns that fly real arenas: one is killed in its second flight and resumed, one flies a scenario, one uses a Ray cluster."""

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


def campaign(folder: Path, temporary: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start `arena campaign` as a user starts it."""
    with (folder / "out.txt").open("ab") as out:
        return subprocess.Popen(
            [sys.executable, "-m", "arena.cli", "campaign", "sweep.yaml", "--results", "results", *options],
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

    first = campaign(tmp_path, runtime_dir, "-j", "1")
    try:
        eventually(lambda: len(runs()) == 2, 120, "the second flight begins", said)
        before = Store(results).records()
    finally:
        first.kill()
        first.wait()
    assert [r.number for r in before.values()] == [1], said()
    eventually(lambda: not any(started_by(run) for run in runs()), 60, "the arena in the air ends", said)

    second = campaign(tmp_path, runtime_dir, "-j", "1")
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


SCENARIO = """\
name: climbs
arena: arena.yaml
steps:
  - at: each.airborne
    expect: each.height > 0.8 m within 5 s
  - expect: each.landed within 30 s
"""
HEIGHTS = """\
name: heights
scenario: climb.smoke.yaml
vary: {height_m: {values: [1.0, 0.5], set: "vehicles.uav1.program.args=['{}']"}}
"""


@pytest.fixture
def heights(tmp_path: Path) -> Path:
    """A folder with a sweep over a scenario: its first flight passes, its second one does not fly high enough."""
    (tmp_path / "arena.yaml").write_text(
        "defaults: {autopilot: builtin}\nvehicles: {uav1: {program: {path: hover.py}}}\n"
    )
    (tmp_path / "hover.py").write_text(PROGRAM.replace("-1.0]", "-float(uav.args[0])]"))
    (tmp_path / "climb.smoke.yaml").write_text(SCENARIO)
    (tmp_path / "sweep.yaml").write_text(HEIGHTS)
    return tmp_path


def fly_heights(folder: Path, temporary: Path, limit_s: float) -> None:
    """Fly the sweep of `heights`, and check that only its first flight passes. limit_s: longest time [s]."""
    flown = campaign(folder, temporary)
    try:
        code = flown.wait(PATIENCE * limit_s)
    finally:
        flown.kill()
        flown.wait()
    said = (folder / "out.txt").read_text()
    assert code == 1, said
    first, second = sorted(Store(folder / "results").records().values(), key=lambda r: r.number)
    assert first.passed and not second.passed, said
    assert "climb.smoke.yaml:5" in second.reasons[0] and "height" in second.reasons[0], second
    assert all(r.measures["airborne_s"] > 1.0 for r in (first, second))


@pytest.mark.flight
def test_flights_of_a_scenario_are_judged_as_in_smoke(heights: Path, runtime_dir: Path) -> None:
    fly_heights(heights, runtime_dir, 120)


@pytest.mark.flight
def test_flights_on_a_ray_cluster_are_flown_and_judged(
    heights: Path, runtime_dir: Path, address: str
) -> None:
    (heights / "sweep.yaml").write_text(f"cluster: {address}\n{HEIGHTS}")
    fly_heights(heights, runtime_dir, 240)
    assert len(list((heights / "results").rglob("csv/uav1.csv"))) == 2, "files come back"
