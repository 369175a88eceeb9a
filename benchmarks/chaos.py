"""Flights of two real vehicles with random faults, which no rule of safety may survive broken: a table and the seeds.

python benchmarks/chaos.py [--flights 300] [--seed 1] [--jobs 2] [--keep FOLDER] [--resume FILE]

Two built-in autopilots in a world of their own pose as real vehicles behind a radio that can be cut. In each flight, processes are
killed, paused and restarted, wires are unplugged, bodies are swapped, pilots take over, another vehicle with the same system id
appears, the log folder is deleted, the disk is full or hangs, and the run is ended in different ways. The rules: no vehicle is
left armed without a confirmed reason, none is reported as landed while armed, no command goes to another hardware uid, none
follows after a pilot took over, and every run ends. Exit code 1: a rule was violated. A flight takes about 20 s.

A full disk needs the right to mount a file system (`unshare --mount`), a disk that hangs needs root. Without it, the table shows
that these faults were not carried out.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.chaos_flight.disk import in_namespace, mount_namespace
from benchmarks.chaos_flight.faults import DISK_FAULTS, draw
from benchmarks.chaos_flight.record import Record, table

ROOT = Path(__file__).parents[1]


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1, help="seed of the first flight; the next ones follow")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 2)
    parser.add_argument("--keep", type=Path, help="folder in which the run folders are kept")
    parser.add_argument(
        "--resume",
        type=Path,
        help="file with one line per flight: seeds that it has are flown again only after a violation, or if nobody took off",
    )
    given = parser.parse_args(argv)
    seeds = range(given.seed, given.seed + given.flights)
    known = {r.seed: r for r in read(given.resume) if r.seed in seeds}
    todo = [seed for seed in seeds if seed not in known or known[seed].why or not known[seed].airborne]

    def note(record: Record) -> None:
        known[record.seed] = record
        if given.resume is not None:
            with given.resume.open("a") as file:
                file.write(record.to_json() + "\n")

    with tempfile.TemporaryDirectory() as scratch:
        campaign(todo, given.keep or Path(scratch), given.jobs, note)
    print(table(known[seed] for seed in sorted(known)))
    return 1 if len(known) < len(seeds) or any(r.why for r in known.values()) else 0


def read(file: Path | None) -> list[Record]:
    """Return the records of a file of `--resume`, without lines that were not completed."""
    found = []
    lines = file.read_text().splitlines() if file is not None and file.exists() else []
    for line in lines:
        with contextlib.suppress(ValueError, TypeError):
            found.append(Record.from_json(line))
    return found


def campaign(
    seeds: Iterable[int], folder: Path, jobs: int, note: Callable[[Record], None] = lambda record: None
) -> list[Record]:
    """Fly all seeds, `jobs` flights at a time, and return the records of the flights that could be flown.

    folder: for the run folders.  note: called with each record.
    """
    found, namespace = [], mount_namespace()
    with ThreadPoolExecutor(jobs) as pool:
        for done in as_completed([pool.submit(fly, seed, folder, namespace) for seed in seeds]):
            record = done.result()
            if isinstance(record, str):
                print(record, file=sys.stderr, flush=True)
                continue
            print(record, file=sys.stderr, flush=True)
            note(record)
            found.append(record)
    return found


def fly(seed: int, folder: Path, namespace: str) -> Record | str:
    """Fly the faults of one seed in a process of its own, and return the record, or why there is none.

    folder: for the run folder.  namespace: from `mount_namespace`, for a flight with a full disk or a disk that hangs.
    """
    place = folder / f"seed-{seed}"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    command = [sys.executable, "-m", "benchmarks.chaos_flight", str(seed), str(place.resolve())]
    if any(fault.what in DISK_FAULTS for fault in draw(seed).faults):
        command = in_namespace(namespace, command)
    with (place / "errors.txt").open("wb") as errors:
        flight = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=errors, stderr=errors)
        _, _, used = os.wait4(flight.pid, 0)
    record = read(place / "record.json")
    if not record:
        lines = (place / "errors.txt").read_text(errors="replace").strip().splitlines()
        return f"seed {seed}: could not be flown: {lines[-1] if lines else 'no message'}"
    return replace(record[0], cpu_s=used.ru_utime + used.ru_stime, load=os.getloadavg()[0])


if __name__ == "__main__":
    raise SystemExit(main())
