"""CPU time of short commands, and time from `arena up` to vehicles in the air, as two tables in Markdown.

python benchmarks/startup.py [--commands N] [--flights N] [--px4-boots N]

Every figure is a median. CPU time is user and system time of one command; the ratio is to `python -c pass` of the same run.
The flight is examples/01_two_quads in real time. With PX4_HOME, PX4's own boot is measured beside it: from the start of its
binary with its own simulator (SIH) to the line "Ready for takeoff!". Flights and boots take turns.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
ARENA = (sys.executable, "-m", "arena.cli")
COMMANDS = {
    "python -c pass": (sys.executable, "-c", "pass"),
    "arena --help": (*ARENA, "--help"),
    "arena check (2 vehicles)": (*ARENA, "check", str(ROOT / "examples/01_two_quads")),
    "arena check (10 vehicles)": (*ARENA, "check", str(ROOT / "examples/10_ten_quads")),
    "arena ps": (*ARENA, "ps"),
    "arena land-all --help": (*ARENA, "land-all", "--help"),
}
PHASES = ("first process starts", "world ready", "programs start", "first in the air", "all in the air")
TIME_LIMIT_S = 120.0
READY_LINE = re.compile(rb"Ready for takeoff")


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--commands", type=int, default=9, metavar="N")
    parser.add_argument("--flights", type=int, default=5, metavar="N")
    parser.add_argument("--px4-boots", type=int, default=5, metavar="N")
    given = parser.parse_args(argv)
    cached = "not written: PYTHONDONTWRITEBYTECODE is set" if sys.dont_write_bytecode else "cached"
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, bytecode {cached}\n")
    with tempfile.TemporaryDirectory() as runtime:
        os.environ["ARENA_RUNTIME_DIR"] = runtime
        if given.commands:
            commands(given.commands)
        if given.flights:
            flights(given.flights, given.px4_boots if os.environ.get("PX4_HOME") else 0)
    return 0


def commands(count: int) -> None:
    """Print the table of commands. The commands take turns, so that all have the same load."""
    taken: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(count + 1):  # the first round fills the caches
        for name, command in COMMANDS.items():
            taken[name].append(cpu_s(command))
    medians = {name: statistics.median(times[1:]) for name, times in taken.items()}
    base = medians["python -c pass"]
    print("| command | CPU, s | ratio |\n| --- | ---: | ---: |")
    for name, median in medians.items():
        print(f"| `{name}` | {median:.3f} | {median / base:.1f} |")


def cpu_s(command: tuple[str, ...]) -> float:
    """Run a command and return its CPU time [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=60, check=False
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def flights(count: int, boots: int) -> None:
    """Print the table of the start of a flight, and of PX4's boot."""
    flown, booted = [], []
    for place in range(max(count, boots)):
        if place < count:
            flown.append(flight())
        if place < boots:
            booted.append(px4_boot_s(Path(os.environ["PX4_HOME"])))
    medians = {name: statistics.median(each[name] for each in flown) for name in PHASES}
    print(f"\nload {os.getloadavg()[0]:.1f}\n\n| two vehicles, from `arena up` to | s |\n| --- | ---: |")
    for name, median in medians.items():
        print(f"| {name} | {median:.2f} |")
    if booted:
        ready = statistics.median(booted)
        print(f"| PX4's own boot to ready, without arena | {ready:.2f} |")
        print(f"\nall in the air / PX4's boot: {medians['all in the air'] / ready:.2f}")


def flight() -> dict[str, float]:
    """Fly until both vehicles are in the air and return the time of each phase [s]. Then land and stop the arena."""
    with tempfile.TemporaryDirectory() as folder:
        for file in (ROOT / "examples/01_two_quads").iterdir():
            if file.is_file():
                shutil.copy(file, folder)
        begun = time.monotonic()
        child = subprocess.Popen(
            [*ARENA, "up", folder, "--headless", "--no-report", "--set", "defaults.autopilot=builtin"],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
        )
        try:
            return _phases(Path(folder), child, begun)
        finally:
            child.send_signal(signal.SIGINT)
            child.wait(timeout=TIME_LIMIT_S)


def _phases(folder: Path, child: subprocess.Popen[bytes], begun: float) -> dict[str, float]:
    while child.poll() is None and time.monotonic() < begun + TIME_LIMIT_S:
        time.sleep(0.2)
        lines = [
            line for file in folder.glob("runs/*/events.jsonl") for line in file.read_text().splitlines()
        ]
        events = [json.loads(line) for line in lines if line.endswith("}")]
        air = [e["mono"] for e in events if str(e.get("event", "")).endswith(": airborne")]
        if len(air) < 2:
            continue
        to = [(e["mono"], e["process"], e.get("to")) for e in events]
        found = (
            to[0][0],
            next(t for t, process, state in to if (process, state) == ("world", "READY")),
            next(t for t, process, state in to if process.startswith("program.") and state == "STARTING"),
            min(air),
            max(air),
        )
        return dict(zip(PHASES, (t - begun for t in found), strict=True))
    raise SystemExit(f"the vehicles were not in the air after {TIME_LIMIT_S:g} s of wall time")


def px4_boot_s(home: Path) -> float:
    """Start PX4 with its own simulator and return the time until it reports that it is ready to take off [s]."""
    with tempfile.TemporaryDirectory() as folder:
        begun = time.monotonic()
        log = Path(folder) / "out.log"
        with log.open("wb") as out:
            child = subprocess.Popen(
                [home / "bin/px4", "-d", "-i", "9", "-w", folder, home / "etc"],
                cwd=folder,
                env={**os.environ, "PX4_SIM_MODEL": "sihsim_quadx"},
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=out,
            )
        try:
            while child.poll() is None and time.monotonic() < begun + TIME_LIMIT_S:
                time.sleep(0.02)
                if READY_LINE.search(log.read_bytes()):
                    return time.monotonic() - begun
        finally:
            child.kill()
            child.wait()
        last = log.read_text(errors="replace")[-500:]
        raise SystemExit(f"PX4 was not ready after {TIME_LIMIT_S:g} s. Its last lines:\n{last}")


if __name__ == "__main__":
    sys.exit(main())
