"""Effects of every failed process on a flight, measured: process x {SIGKILL, SIGSTOP} x {ground, air}.

python benchmarks/processes.py [--autopilot stand-in|px4] [--sortie PATTERN ...]

Flies the table of `tests/end_to_end/process_table.py`, one sortie after the other. Prints the table in Markdown to stdout and each
result to stderr. Run it on a quiet machine: a restart takes wall time. Exit code 1: a cell does not end as the table says.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.end_to_end.flight import Hangar
from tests.end_to_end.process_table import CELLS, SORTIES, Cell, End, Flown, Hit, Sorties, Track, problems

COLUMNS = (
    "process",
    "signal",
    "where",
    "the process",
    "its vehicle",
    "the others",
    "after, s",
    "touchdown, m/s",
    "drift, m",
    "exit",
)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--autopilot",
        choices=("stand-in", "px4"),
        default="stand-in",
        help="autopilot of the cells with a PX4",
    )
    parser.add_argument("--sortie", nargs="*", default=["*"], metavar="PATTERN")
    given = parser.parse_args(argv)
    print(row(COLUMNS), row(["---"] * len(COLUMNS)), sep="\n", flush=True)
    rows, wrong = {}, 0
    for hit, flown in _fly(given.sortie, real=given.autopilot == "px4"):
        if isinstance(flown, str):
            print(flown, file=sys.stderr)
            wrong += 1
            continue
        found = problems(flown, hit)
        wrong += bool(found)
        print(f"{hit.cell}: {'; '.join(found) or 'as expected'}", file=sys.stderr, flush=True)
        rows[hit.cell] = measured(hit, flown)
    for cell in CELLS:
        if cell in rows:
            print(rows[cell])
    return 1 if wrong else 0


def _fly(patterns: list[str], *, real: bool) -> Iterator[tuple[Hit, Flown | str]]:
    for i, sortie in enumerate(SORTIES):
        if not any(fnmatchcase(sortie.name, pattern) for pattern in patterns) or (real and not sortie.px4):
            continue
        with tempfile.TemporaryDirectory() as folder:
            address = f"127.67.{os.getpid() % 250 + 1}.{i + 1}"
            sorties = Sorties(lambda: Hangar(Path(folder), address))  # noqa: B023  called in this round
            try:
                flown: Flown | str = sorties.flown(sortie, real=real)
            except AssertionError as error:
                flown = str(error)
            for hit in sortie.hits:
                yield hit, flown


def measured(hit: Hit, flown: Flown) -> str:
    """Return one row: the worst of all vehicles for a process of the arena, else the values of its vehicle."""
    own = [flown.tracks[hit.vehicle]] if hit.vehicle else list(flown.tracks.values())
    rest = _bystanders(hit, flown)
    cell: Cell = hit.cell
    # A typed command has no fixed time; with several hits the expected exit code is printed.
    sank = [t.sank_s for t in own if t.end is not End.COMMANDED or cell.process == "copilot"]
    code = flown.code if len(flown.sortie.hits) == 1 else cell.code
    return row(
        (
            f"`{cell.process}`",
            cell.signal,
            cell.where,
            str(flown.fates[hit] or ""),
            _ends(own),
            _ends(rest) if hit.vehicle else "the same",
            _worst(sank),
            _worst([t.touchdown_m_s for t in own]),
            _worst([t.drift_m for t in own]),
            "killed" if code is None else str(code),
        )
    )


def _bystanders(hit: Hit, flown: Flown) -> list[Track]:
    """Return the vehicles whose processes were not hit."""
    aimed = {h.vehicle for h in flown.sortie.hits}
    return [track for name, track in flown.tracks.items() if name not in aimed]


def _ends(tracks: list[Track]) -> str:
    return ", ".join(sorted({str(t.end) for t in tracks}))


def _worst(values: list[float | None]) -> str:
    known = [v for v in values if v is not None]
    return f"{max(known):.2f}" if known else ""


def row(cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"  # type: ignore[call-overload]


if __name__ == "__main__":
    sys.exit(main())
