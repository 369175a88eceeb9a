"""Flights that end badly without a copilot, with one and without; and how far vehicles go on when it stops them.

    python benchmarks/copilot.py [--autopilot builtin|px4|both] [--case head-on|wall|stops] [--runs 5] [--with-only]

head-on: two programs sent through each other's place at 1.5 m/s each.  wall: a program that flies into the wall at 3 m/s.
stops: 1, 2 and 3 m/s, steady and still speeding up, along north and obliquely: the way the copilot counted on, and the way flown.
Prints tables in Markdown. Exit code 1: a flight that crashed with a copilot or did not without, or a way longer than counted on.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

PROGRAM = Path(__file__).parents[1] / "tests" / "end_to_end" / "programs" / "copilot_pilot.py"
RADIUS_M = 0.275
"""Of the vehicle: without a geofence its centre stays so far from the walls."""
FIRST_ID = 65
"""PX4 binds its ports on every address: other arenas of this computer may fly theirs with the low ids."""
_NEEDS = re.compile(r"to stop from ([\d.]+) m/s it needs ([\d.]+) m and ([\d.]+) m in reserve, and the \w+ is (-?[\d.]+) m away")


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What a flight left. crashed: the world's words, "" for none. places: name -> truth [m] [NED] (T, 3)."""

    code: int
    crashed: str
    events: tuple[str, ...]
    places: dict[str, NDArray[np.float64]]

    @property
    def closest_m(self) -> float:
        """Of the first two vehicles, at the same rows: the logs are written at the same instants."""
        a, b = list(self.places.values())[:2]
        n = min(len(a), len(b))
        return float(np.linalg.norm(a[:n] - b[:n], axis=1).min())


def fly(autopilot: str, size: tuple[float, float, float], vehicles: dict[str, tuple[float, float, str]], *, copilot: bool,
        address: str) -> Flown:  # fmt: skip
    """vehicles: name -> start north, east [m], arguments of the program."""
    lines = [f"address: {address}", f"world: {{size: {list(size)}}}", f"defaults: {{autopilot: {autopilot}}}"]
    lines += ["copilot: {}"] if copilot else []
    lines += ["vehicles:"]
    for k, (name, (north, east, words)) in enumerate(vehicles.items()):
        program = f"{{path: '{PROGRAM}', args: [{', '.join(repr(w) for w in words.split())}]}}"
        lines.append(f"  {name}: {{id: {FIRST_ID + k}, start: {{position: [{north}, {east}, 0]}}, program: {program}}}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arena.yaml"
        file.write_text("\n".join(lines) + "\n")
        up = ["up", str(file), "--headless", "--until-done", "--no-report", "--speed", "max", "--time-limit", "240"]
        done = subprocess.run([sys.executable, "-m", "arena.cli", *up], capture_output=True, text=True, check=False,
                              env={**os.environ, "ARENA_RUNTIME_DIR": folder})  # fmt: skip
        found = [run for run in (Path(folder) / "runs").glob("*") if (run / "outcome.json").exists()]
        if not found:
            raise SystemExit(done.stdout + done.stderr)
        return _read(found[0], list(vehicles))


def _read(run: Path, names: list[str]) -> Flown:
    outcome = json.loads((run / "outcome.json").read_text())
    verdicts = outcome["processes"]["world"]["stats"]["vehicles"]
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    said = tuple(str(e["event"]) for e in events if e["process"] == "copilot" and "event" in e)
    crashed = "; ".join(f"{n}: {verdicts[n]['crashed']}" for n in names if verdicts[n]["crashed"])
    return Flown(code=outcome["exit_code"], crashed=crashed, events=said, places={n: _truth(run, n) for n in names})


def _truth(run: Path, name: str) -> NDArray[np.float64]:
    with (run / "csv" / f"{name}.csv").open() as file:
        rows = [[row[f"truth.pos.{axis}"] for axis in ("north", "east", "down")] for row in csv.DictReader(file)]
    return np.array([[float(x) for x in row] for row in rows if all(row)])


def head_on(autopilot: str, *, copilot: bool, address: str) -> tuple[Flown, float]:
    """-> closest approach [m]."""
    vehicles = {"uav1": (-4.5, 0.0, "1.5 0 5.5"), "uav2": (4.5, 0.0, "-1.5 0 5.5")}
    flown = fly(autopilot, (24, 8, 4), vehicles, copilot=copilot, address=address)
    return flown, flown.closest_m


def wall(
    autopilot: str, *, copilot: bool, address: str, speed: float = 3.0, run_m: float = 10.0, oblique: bool = False
) -> tuple[Flown, float]:
    """run_m: of its start from the wall; oblique: into a corner. -> the least distance of its centre from a wall [m]."""
    half, start = 7.0, 7.0 - run_m
    velocity = f"{speed * math.sqrt(0.5):.4f} {speed * math.sqrt(0.5):.4f}" if oblique else f"{speed} 0"
    vehicles = {"uav1": (start, start if oblique else 0.0, f"{velocity} 20")}
    flown = fly(autopilot, (2 * half, 2 * half if oblique else 6.0, 4), vehicles, copilot=copilot, address=address)
    place = flown.places["uav1"]
    return flown, half - float(place[:, :2].max() if oblique else place[:, 0].max())


def crashes(autopilot: str, case: str, runs: int, *, with_only: bool, address: str) -> Iterator[bool]:
    flight = {"head-on": head_on, "wall": wall}[case]
    for copilot in (True,) if with_only else (False, True):
        nearest, bad, codes = [], 0, []
        for _ in range(runs):
            flown, least = flight(autopilot, copilot=copilot, address=address)
            nearest.append(least)
            bad += bool(flown.crashed)
            codes.append(flown.code)
            if bool(flown.crashed) is copilot:
                print(flown, file=sys.stderr)
        least_, most = min(nearest), max(nearest)
        print(
            f"| {case} | {autopilot} | {'yes' if copilot else 'no'} | {runs} | {bad} | {least_:.2f} to {most:.2f} |", flush=True
        )
        yield bad == (0 if copilot else runs)


def stops(autopilot: str, address: str) -> Iterator[bool]:
    for speed in (1.0, 2.0, 3.0):
        for words, run_m, oblique in (("steady", 10.0, False), ("speeding up", 1.5 + 1.1 * speed, False), ("oblique", 9.0, True)):
            flown, least = wall(autopilot, copilot=True, address=address, speed=speed, run_m=run_m, oblique=oblique)
            told = next((m for m in map(_NEEDS.search, flown.events) if m), None)
            if told is None:
                print(flown.events, file=sys.stderr)
                yield False
                continue
            at, needs, _, left = (float(x) for x in told.groups())
            fence = least - RADIUS_M  # what was left of the way to the fence
            way = left - fence
            print(f"| {autopilot} | {words} | {speed:g} | {at:.1f} | {needs:.2f} | {way:.2f} | {fence:.2f} |", flush=True)
            yield way <= needs and not flown.crashed


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--autopilot", choices=("builtin", "px4", "both"), default="builtin")
    options.add_argument("--case", choices=("head-on", "wall", "stops"), action="append")
    options.add_argument("--runs", type=int, default=5)
    options.add_argument("--with-only", action="store_true", help="do not fly without a copilot")
    options.add_argument("--address", default="127.65.9.1")
    given = options.parse_args()
    pilots = ("builtin", "px4") if given.autopilot == "both" else (given.autopilot,)
    cases = given.case or ["head-on", "wall", "stops"]
    right: list[bool] = []
    for case in cases:
        if case == "stops":
            print(
                "| autopilot | flight | asked m/s | told at m/s | counted on m | flown m | left to the fence m |\n| "
                + "--- | " * 7
            )
        else:
            print("| flight | autopilot | copilot | runs | crashed | closest m |\n| " + "--- | " * 6)
        for pilot in pilots:
            right += stops(pilot, given.address) if case == "stops" else crashes(
                pilot, case, given.runs, with_only=given.with_only, address=given.address)  # fmt: skip
    return 0 if all(right) else 1


if __name__ == "__main__":
    sys.exit(main())
