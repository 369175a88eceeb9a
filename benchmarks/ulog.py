"""Benchmark of the built-in autopilots' logs (ULog): CPU time with and without them, in turns, in one process.

    python benchmarks/ulog.py [--counts 1 10 50] [--rounds 15]

World and autopilots hover as in `benchmarks/world.py`. Each figure is the median over many rounds of one simulated second, in CPU
time of the whole process, which includes the thread that writes the files.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from world import Fleet, settings

from arena.autopilot import Autopilots, UlogFiles

SECOND = 250  # steps


def flying(count: int, folder: Path, ulog: Path | None) -> Fleet:
    """Return hovering vehicles. ulog: folder of their logs; None: no logs"""
    slice_ = settings(count, folder)
    fleet = Fleet(slice_)
    sink = UlogFiles(ulog) if ulog is not None else None
    fleet.autopilots = Autopilots(slice_, fleet.world.period_s, ulog=sink)
    fleet.take_off()
    return fleet


def second_ms(fleet: Fleet) -> float:
    """Fly for one simulated second and return its CPU time [ms]."""
    began = time.process_time()
    fleet.run(SECOND)
    return 1e3 * (time.process_time() - began)


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--counts", type=int, nargs="+", default=[1, 10, 50])
    options.add_argument("--rounds", type=int, default=15)
    given = options.parse_args()
    print("| vehicles | without ms/s | with ms/s | per vehicle ms/s | log kB/s per vehicle |")
    print("|---:|---:|---:|---:|---:|")
    for count in given.counts:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            without, logged = flying(count, folder, None), flying(count, folder, folder / "ulog")
            times: tuple[list[float], list[float]] = ([], [])
            for _ in range(given.rounds):
                times[0].append(second_ms(without))
                times[1].append(second_ms(logged))
            simulated_s = logged.steps / SECOND - 4.0  # armed after 4 s
            logged.autopilots.close()
            size = sum(path.stat().st_size for path in (folder / "ulog").iterdir()) / count / simulated_s
            a, b = map(statistics.median, times)
            print(f"| {count} | {a:.1f} | {b:.1f} | {(b - a) / count:.2f} | {size / 1e3:.0f} |")


if __name__ == "__main__":
    main()
