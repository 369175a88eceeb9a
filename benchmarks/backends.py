"""Fly one program with both backends of `UAV` on three kinds of vehicle, and print the tracking errors as a table.

    python benchmarks/backends.py [--vehicles builtin px4 hardware] [--keep FOLDER]

The program is examples/14_two_backends/circle.py. Between two flights only `--set defaults.backend=...` changes. The vehicles:
the built-in autopilot and PX4 in simulated time, and a hardware vehicle in real time. The hardware vehicle is simulated: a second
world on another loopback address sends what a flight controller and cameras send, so the arena takes it for a real one.
Error: RMS distance between setpoint and pose captured by the cameras, while the setpoint moves along the circle [m].
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tests.end_to_end.posing import PosingRoom, PosingVehicle  # noqa: E402

PROGRAM = ROOT / "examples" / "14_two_backends" / "circle.py"
VEHICLES = {"builtin": "built-in autopilot", "px4": "PX4 v1.16", "hardware": "hardware (127.0.0.2)"}
BACKENDS = ("mavlink", "mavsdk")
ARENA, REALITY, WIRE_PORT = "127.0.0.1", "127.0.0.2", 14540
MOVING_M_S = 0.2  # horizontal speed of the setpoint
NED = ("north", "east", "down")

Array = NDArray[np.float64]


def yaml_of(kind: str) -> str:
    """Return the arena.yaml for one kind of vehicle."""
    if kind != "hardware":
        return f"address: {ARENA}\nvehicles:\n  uav1: {{autopilot: {kind}, program: {PROGRAM}}}\n"
    return (
        f"address: {ARENA}\nmocap: {{source: natnet, server: {REALITY}}}\npreflight: {{axes_check: none}}\n"
        f"vehicles:\n  uav1: {{autopilot: hardware, profile: iris, radio: none, program: {PROGRAM}, "
        f'url: "udpin:{ARENA}:{WIRE_PORT}"}}\n'
    )


def fly(kind: str, backend: str, keep: Path | None) -> Array:
    """Fly the program once. Return the distances between setpoint and captured pose while the setpoint moves [m] (n,)."""
    with tempfile.TemporaryDirectory(prefix="b-") as name:
        folder = Path(name)
        (folder / "arena.yaml").write_text(yaml_of(kind))
        speed = () if kind == "hardware" else ("--speed", "max")
        command = [
            sys.executable,
            "-m",
            "arena",
            "up",
            str(folder / "arena.yaml"),
            "--headless",
            "--until-done",
        ]
        command += ["--yes", "--no-report", "--set", f"defaults.backend={backend}", *speed]
        if kind == "hardware":
            start: list[float] = [0.0, 0.0, 0.0]
            posing = PosingVehicle(name="uav1", number=1, position=start, partner=(ARENA, WIRE_PORT))
            with PosingRoom(REALITY, posing):
                done = run(command)
        else:
            done = run(command)
        if done.returncode:
            raise SystemExit(
                f"{kind} with {backend} failed ({done.returncode}):\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
            )
        (log,) = folder.glob("runs/*/csv/uav1.csv")
        if keep:
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{kind}_{backend}.csv").write_text(log.read_text())
        return errors(log)


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def errors(log: Path) -> Array:
    """Return the distances between setpoint and captured pose in all rows with a horizontally moving setpoint [m] (n,)."""
    with log.open() as lines:
        rows = list(csv.DictReader(lines))
    pose, goal, speed = (
        np.array([[float(row[f"{group}.{axis}"] or "nan") for axis in NED] for row in rows])
        for group in ("mocap.pos", "pos_ref", "vel_ref")
    )
    moving = np.linalg.norm(speed[:, :2], axis=1) > MOVING_M_S
    found = np.linalg.norm(pose - goal, axis=1)[moving]
    return found[np.isfinite(found)]


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--vehicles", nargs="+", choices=list(VEHICLES), default=list(VEHICLES))
    options.add_argument("--keep", type=Path, help="folder for the logs")
    given: Any = options.parse_args()
    print("| backend | " + " | ".join(VEHICLES[kind] for kind in given.vehicles) + " |")
    print("|---|" + "---|" * len(given.vehicles), flush=True)
    for backend in BACKENDS:
        print(f"| `{backend}` |", end="", flush=True)
        for kind in given.vehicles:
            off = fly(kind, backend, given.keep)
            rms = float(np.sqrt(np.mean(off**2)))
            print(f" {rms:.3f} m (largest {off.max():.3f} m, {len(off)} rows) |", end="", flush=True)
        print(flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
