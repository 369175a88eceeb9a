"""Whole arenas of 1, 2 and 10 vehicles in real time: does time keep its pace, do frames and poses, and at what cost?

    python benchmarks/flights.py [--vehicles 1 2 10] [--repeat 1]

Flies the first example's program with every vehicle, forwarders, router and recorder included, and prints one line per flight.
Quote medians of several; the machine's other work shows in every column.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

PROGRAM = Path(__file__).parents[1] / "examples" / "01_two_quads" / "position_setpoints.py"
COLUMNS = (
    "vehicles",
    "exit",
    "airborne s",
    "last s",
    "late p99 ms",
    "worst ms",
    "rtf min",
    "rtf max",
    "mocap Hz",
    "poses Hz",
    "worst end m",
    "landing m",
    "cpu cores",
    "world cpu",
)


def arena_of(count: int, folder: Path) -> Path:
    """Vehicles in two rows, three metres apart, in a room that holds them."""
    rows = -(-count // 2)
    lines = [
        f"world: {{size: [{3 * rows + 4}, 8, 3]}}",
        f"defaults: {{profile: iris, program: {PROGRAM}}}",
        "vehicles:",
    ]
    for i in range(count):
        north, east = 2.5 * (i // 2 - (rows - 1) / 2), 3.0 * (i % 2) - 1.5
        lines.append(f"  uav{i + 1}: {{start: {{position: [{north}, {east}, 0]}}}}")
    path = folder / "arena.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


def fly(count: int) -> dict[str, Any]:
    """One flight; the figures of its summary and of its processes."""
    with tempfile.TemporaryDirectory() as folder:
        path = arena_of(count, Path(folder))
        command = [
            sys.executable,
            "-m",
            "arena.cli",
            "up",
            str(path),
            "--headless",
            "--until-done",
            "--time-limit",
            "120",
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        runs = list(Path(folder).glob("runs/*"))
        if not runs:
            raise SystemExit(done.stderr)
        (run,), code = runs, done.returncode
        summary = json.loads((run / "summary.json").read_text())
        outcome = json.loads((run / "outcome.json").read_text())
    return row_of(count, code, summary, outcome)


def row_of(count: int, code: int, summary: dict[str, Any], outcome: dict[str, Any]) -> dict[str, Any]:
    world, vehicles, processes = summary["world"], summary["vehicles"].values(), outcome["processes"]
    poses = [p["stats"]["rate_hz"] for n, p in processes.items() if n.startswith("forward.")]
    airborne = [v["airborne_after_s"] for v in vehicles]
    cells = (
        count,
        code,
        min(airborne),
        max(airborne),
        world["lateness_p99_ms"],
        world["lateness_worst_ms"],
        world["rtf_min"],
        world["rtf_max"],
        processes["mocap"]["stats"]["rate_hz"],
        min(poses),
        max(v["setpoints"]["worst_m"] for v in vehicles),
        max(v["landing"]["error_m"] for v in vehicles),
        sum(p["cpu_mean"] for p in processes.values()),
        processes["world"]["cpu_mean"],
    )
    return dict(zip(COLUMNS, cells, strict=True))


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--vehicles", type=int, nargs="+", default=[1, 2, 10])
    options.add_argument("--repeat", type=int, default=1)
    given = options.parse_args()
    print(" | ".join(f"{c:>11}" for c in COLUMNS))
    failed = 0
    for count in given.vehicles:
        for _ in range(given.repeat):
            row = fly(count)
            failed += row["exit"] != 0
            print(
                " | ".join(f"{v:11.3f}" if isinstance(v, float) else f"{v:11}" for v in row.values()),
                flush=True,
            )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
