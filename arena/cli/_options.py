"""Options that several commands have."""

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
        help="number of flights at the same time; default: number of CPU cores",
    ),
]


def jobs_or_cores(jobs: int | None) -> int:
    """Return the number of flights at the same time: as given, or one per CPU core of this computer."""
    return jobs or len(os.sched_getaffinity(0))
