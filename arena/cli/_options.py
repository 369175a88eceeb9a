"""Command-line options that several commands share."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from arena.errors import InputError

File = Annotated[Path, typer.Argument(help="YAML file of the arena, or a folder with arena.yaml")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="override one value of the YAML, such as sim.speed=2"),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "-j",
        "--jobs",
        metavar="N",
        min=1,
        help="number of flights to fly at the same time; default: the number of CPU cores (`arena smoke --speed max`: one more)",
    ),
]

TimeLimit = Annotated[
    float | None,
    typer.Option("--time-limit", metavar="S", min=0.0, help="end the run after S seconds of wall time"),
]
NoReport = Annotated[
    bool,
    typer.Option(
        "--no-report",
        help="write no summary and no report.html, only the CSV logs; `arena report RUN` can write them later",
    ),
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="print only the verdict and failures")]
Verbose = Annotated[
    bool,
    typer.Option("-v", "--verbose", help="print every start and stop of a process, and the full summary"),
]
AsJson = Annotated[bool, typer.Option("--json", help="print one JSON object per line, for other programs")]


def speed_of(text: str) -> float | str:
    """Return the value of an option --speed: a number above 0 and at most 1000, or `max`. Raises InputError for another text."""
    if text == "max":
        return text
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= 1000.0:
        raise InputError(f"--speed: got {text}, expected a number above 0 and at most 1000, or max")
    return value


def jobs_or_cores(jobs: int | None) -> int:
    """Return the number of flights to fly at the same time: `jobs`, or one per CPU core if `jobs` is None."""
    return jobs or len(os.sched_getaffinity(0))
