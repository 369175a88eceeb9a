"""`arena summary RUN`: print the full result of a run."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer

from arena.cli.runs import last_run
from arena.errors import InputError


def register(app: typer.Typer) -> None:
    """Add the command `arena summary` to the typer app."""

    @app.command()
    def summary(
        run: Annotated[
            Path,
            typer.Argument(
                metavar="RUN",
                help="run folder, as `arena runs` lists them, or the folder of an arena for its last run",
            ),
        ],
        as_json: Annotated[
            bool, typer.Option("--json", help="print summary.json for other programs")
        ] = False,
    ) -> None:
        """Print the full result of a run: the verdict and the report (summary.txt)."""
        from arena.cli._summary import lines_of

        run = last_run(run)
        if not (run / "plan.json").is_file():
            raise InputError(f"{run}: not a run folder. `arena runs` lists run folders")
        text = run / ("summary.json" if as_json else "summary.txt")
        if not as_json:
            print("\n".join(lines_of(run, columns=shutil.get_terminal_size((160, 24)).columns)))
        if text.is_file():
            print(text.read_text().rstrip())
        else:
            raise InputError(f"{run}: this run has no report. Create it with: arena report {run}")
