"""Flights of two real vehicles with random faults, which no rule of safety may survive broken: a table and the seeds.

python benchmarks/chaos.py [--flights 300] [--seed 1] [--jobs 2] [--keep FOLDER]

Two built-in autopilots in a world of their own pose as real vehicles behind a radio that can be cut. In each flight, processes are
killed, paused and restarted, wires are unplugged, bodies are swapped, pilots take over, another vehicle with the same system id
appears, the log folder is deleted, and the run is ended in different ways. The rules: no vehicle is left armed without a confirmed
reason, none is reported as landed while armed, no command goes to another hardware uid, and none follows after a pilot took over.
Exit code 1: a rule was violated. A flight takes about half a minute.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.chaos_flight.faults import draw
from benchmarks.chaos_flight.flight import ChaosFlight, Result
from tests.end_to_end.flight import Hangar


def fly(seed: int, folder: str) -> Result:
    """Fly the faults of one seed in a process of its own. folder: for the run folder."""
    place = Path(folder) / f"seed-{seed}"
    place.mkdir(parents=True, exist_ok=True)
    net = f"127.{71 + seed // 60000}.{seed // 240 % 250}.{seed % 240 + 1}"
    room = f"127.{101 + seed // 60000}.{seed // 240 % 250}.{seed % 240 + 1}"
    return ChaosFlight(draw(seed), Hangar(place, net), room).fly()


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1, help="seed of the first flight; the next ones follow")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 2)
    parser.add_argument("--keep", type=Path, help="folder in which the run folders are kept")
    given = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as scratch:
        folder = str(given.keep or scratch)
        results = campaign(range(given.seed, given.seed + given.flights), folder, given.jobs)
    return _report(results)


def campaign(seeds: range, folder: str, jobs: int) -> list[Result]:
    """Fly all seeds, `jobs` flights at a time, and return the results of the flights that could be flown. folder: for run folders."""
    found = []
    with ProcessPoolExecutor(jobs) as pool:
        begun = {pool.submit(fly, seed, folder): seed for seed in seeds}
        for done in as_completed(begun):
            error = done.exception()
            if error is not None:
                print(f"seed {begun[done]}: could not be flown: {error}", file=sys.stderr, flush=True)
                continue
            result = done.result()
            words = "; ".join(result.why) or "ok"
            flown = f"{result.took_off} took off, {result.lasted_s:.0f} s"
            print(
                f"seed {result.script.seed}: {words} ({flown}) | {result.script}", file=sys.stderr, flush=True
            )
            found.append(result)
    return found


def _report(results: list[Result]) -> int:
    """Print the table of the campaign. Return the exit code."""
    faults = Counter(fault.what for r in results for fault in r.script.faults)
    faults.update(f"end: {r.script.end}" for r in results)
    faults["late join"] = sum(bool(r.script.late) for r in results)
    broken = Counter(fault.what for r in results if r.why for fault in r.script.faults)
    broken.update(f"end: {r.script.end}" for r in results if r.why)
    print("| fault | flights | of these with a violation |\n|---|---|---|")
    for what, count in sorted(faults.items()):
        print(f"| {what} | {count} | {broken[what]} |")
    wrong = [r for r in results if r.why]
    took_off, forgotten = sum(r.took_off for r in results), sum(len(r.forgotten) for r in results)
    print(
        f"\n{len(results)} flights, {took_off} vehicles took off, {forgotten} declared dead by the operator, {len(wrong)} with a violation"
    )
    for r in wrong:
        print(f"seed {r.script.seed}: {'; '.join(r.why)} | {r.script}")
    return 1 if wrong or not results else 0


if __name__ == "__main__":
    raise SystemExit(main())
