"""Flight of two programs that are written against the names of the thesis."""

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

PROGRAMS = Path(__file__).parent / "programs"


@pytest.mark.flight
def test_programs_with_the_names_of_the_thesis_fly(tmp_path, runtime_dir):
    file = tmp_path / "arena.yaml"
    vehicles = {
        "uav1": {"program": {"path": str(PROGRAMS / "two_threads.py"), "args": ["0.5"]}},
        "uav2": {"program": str(PROGRAMS / "coroutines.py"), "start": {"position": [-2, 0, 0]}},
    }
    address = f"127.57.{os.getpid() % 250 + 1}.1"
    file.write_text(
        json.dumps({"address": address, "defaults": {"autopilot": "builtin"}, "vehicles": vehicles})
    )
    command = [sys.executable, "-m", "arena.cli", "up", str(file), "--headless", "--until-done"]
    command += ["--time-limit", "60", "--speed", "max", "--no-report", "--runs", str(tmp_path / "runs")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=590, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    said = (run / "logs" / "program.uav2.log").read_text()
    assert float(re.search(r"error_m ([\d.]+)", said)[1]) < 0.3
    with (run / "csv" / "uav1.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    published = [row for row in rows if row["pos_ref.north"] and row["pos_ref.down"]]
    north, down = ([float(row[f"pos_ref.{axis}"]) for row in published] for axis in ("north", "down"))
    assert len(published) > 100 and np.median(north) == pytest.approx(0.5, abs=0.1)
    assert np.median(down) == pytest.approx(-1.2, abs=0.25)
    height = [-float(row["truth.pos.down"]) for row in rows if row["truth.pos.down"]]
    assert max(height) > 1.0 and height[-1] < 0.3
