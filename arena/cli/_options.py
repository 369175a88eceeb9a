"""Command-line options that several commands share."""

from __future__ import annotations

import os
from typing import Annotated

import typer

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


def jobs_or_cores(jobs: int | None) -> int:
    """Return the number of flights to fly at the same time: `jobs`, or one per CPU core if `jobs` is None."""
    return jobs or len(os.sched_getaffinity(0))
