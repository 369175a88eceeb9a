"""`arena check`: prints every problem of an arena at once, or `ok` with a description of what would run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arena.cli._checking import CheckOptions
from arena.cli._checking import check as check_arena
from arena.cli._options import File, Set


def register(app: typer.Typer) -> None:
    """Add the command `arena check` to the typer app."""

    @app.command()
    def check(
        file: File = Path("arena.yaml"),
        set_: Set = None,
        machine: Annotated[
            bool,
            typer.Option(
                help="also check this computer: free ports, pybullet, serial devices, and the commands in the section `tools` of the YAML"
            ),
        ] = True,
    ) -> None:
        """Print every problem of an arena at once, or `ok` and what would run. Starts nothing."""
        check_arena(CheckOptions(file=file, overrides=tuple(set_ or ()), machine=machine))
