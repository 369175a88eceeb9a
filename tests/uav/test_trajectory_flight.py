"""A circle flown by position setpoints alone, with velocity and with acceleration: tracking, common start, reference in the log."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

PROGRAM = Path(__file__).parent / "programs" / "circle.py"
SETPOINTS = {"uav1": "position", "uav2": "position+velocity", "uav3": "position+velocity+acceleration"}
LAP_S = 2.0 * np.pi / 0.6


def arena_yaml(folder: Path, autopilot: str = "builtin") -> Path:
    """Write an arena with one vehicle for each kind of setpoint, 4 m apart."""
    vehicles = {
        name: {"start": {"position": [0, 4 * i - 4, 0]}, "program": {"path": str(PROGRAM), "args": [kind]}}
        for i, (name, kind) in enumerate(SETPOINTS.items())
    }
    arena = {
        "name": "circle",
        "address": f"127.59.{os.getpid() % 250 + 1}.1",
        "world": {"size": [6, 14, 4]},
        "defaults": {"autopilot": autopilot},
        "vehicles": vehicles,
    }
    file = folder / "arena.yaml"
    file.write_text(json.dumps(arena))
    return file


def tracking_rms(log: Path, start_s: float) -> float:
    """Return the rms distance between truth and published reference in the second lap [m]. start_s: of the circle [s]."""
    with log.open() as lines:
        rows = list(csv.DictReader(lines))

    def column(name: str) -> np.ndarray:
        return np.array(
            [[float(row[f"{name}.{axis}"] or "nan") for axis in ("north", "east", "down")] for row in rows]
        )

    t = np.array([float(row["time.seconds"]) for row in rows])
    second_lap = (t > start_s + LAP_S) & (t < start_s + 2.0 * LAP_S - 0.1)
    error = (column("truth.pos") - column("pos_ref"))[second_lap]
    assert len(error) > 250
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def fly(folder: Path, autopilot: str) -> Path:
    """Fly the arena at full speed and return its run folder."""
    command = [
        sys.executable,
        "-m",
        "arena.cli",
        "up",
        str(arena_yaml(folder, autopilot)),
        "--headless",
        "--until-done",
    ]
    command += ["--time-limit", "150", "--speed", "max", "--no-report", "--runs", str(folder / "runs")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=590, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = (folder / "runs").iterdir()
    return run


@pytest.mark.flight
def test_velocity_setpoints_halve_the_tracking_error_of_a_circle(tmp_path, runtime_dir):
    run = fly(tmp_path, "builtin")
    starts = [
        re.search(r"start ([\d.]+) now ([\d.]+)", (run / "logs" / f"program.{name}.log").read_text())
        for name in SETPOINTS
    ]
    rms = {
        kind: tracking_rms(run / "csv" / f"{name}.csv", float(starts[0][1]))
        for name, kind in SETPOINTS.items()
    }
    print(rms)
    assert 0.5 < rms["position"] < 0.9
    assert rms["position+velocity"] < 0.5 * rms["position"]
    assert rms["position+velocity+acceleration"] < rms["position+velocity"]
    assert len({m[1] for m in starts}) == 1, "one common start time"
    assert all(float(m[2]) == pytest.approx(float(m[1]), abs=0.005) for m in starts)
