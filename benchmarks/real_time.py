"""Number of vehicles, with a program each, that fly in real time on this machine.

    python benchmarks/real_time.py [--vehicles 5 10 20] [--seconds 20] [--group] [--other PYTHON]

Each arena of `benchmarks/fused.py` is flown at `--speed 1`. The window begins 12 s after the start of the simulation, when all vehicles
fly. For each number of vehicles the table shows the real-time factor (simulated time divided by wall time), and the CPU time of all
processes divided by the wall time. A factor below 0.98 means that the machine is too slow for this number of vehicles.

With `--other` each flight is followed by one with another installation of the project, such as an older version. PYTHON is the
interpreter of this installation.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fused import FROM_S, _wait_for, cpu_s, processes, write_arena


def fly(count: int, seconds: float, python: str, *, group: bool) -> tuple[float, float]:
    """Fly one arena in real time. Return the real-time factor and the CPU time per second of wall time.

    python: interpreter that has the project.  group: the programs of all vehicles run in one process.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        path = write_arena(count, FROM_S + 3.0 * seconds, folder, group=group, fleet=False)
        command = [python, "-m", "arena", "up", str(path), "--headless", "--speed", "1"]
        with (folder / "out").open("w") as out:
            arena = subprocess.Popen([*command, "--until-done"], stdout=out, stderr=out, cwd=folder)
        try:
            return _measure(arena, folder, seconds)
        finally:
            arena.terminate()
            try:
                arena.wait(60.0)
            except subprocess.TimeoutExpired:
                arena.kill()


def _measure(arena: subprocess.Popen[bytes], folder: Path, seconds: float) -> tuple[float, float]:
    clock = _wait_for(arena, folder)
    before = {pid: cpu_s(pid) for pid in processes(arena.pid)}
    began, began_s = time.monotonic(), clock.now()
    time.sleep(seconds)
    wall_s, simulated_s = time.monotonic() - began, clock.now() - began_s
    spent = sum(max(0.0, cpu_s(pid) - was) for pid, was in before.items())
    return simulated_s / wall_s, spent / wall_s


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--vehicles", type=int, nargs="+", default=[5, 10, 20])
    options.add_argument("--seconds", type=float, default=20.0, help="wall time of each measurement")
    options.add_argument("--group", action="store_true", help="programs of all vehicles in one process")
    options.add_argument(
        "--other", metavar="PYTHON", help="interpreter of another installation, which flies in turns"
    )
    given = options.parse_args()
    print("| vehicles | installation | real-time factor | CPU s per s |\n|---:|---|---:|---:|")
    for count in given.vehicles:
        for name, python in (("this", sys.executable), ("other", given.other)):
            if python is not None:
                factor, cpu = fly(count, given.seconds, python, group=given.group)
                print(f"| {count} | {name} | {factor:.3f} | {cpu:.2f} |", flush=True)


if __name__ == "__main__":
    main()
