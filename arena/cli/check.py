"""`arena check`: prints every problem of an arena at once, or `ok` with a description of what would run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arena.cli._arena import File, Set, at_free_address, what_would_run


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
        from arena.plan import make_plan
        from arena.plan.machine import check_machine
        from arena.schema import load_arena

        arena = load_arena(file, set_ or [])
        plan = make_plan(arena)
        if machine:
            arena, plan, moved = at_free_address(arena, plan, set_ or [])
            check_machine(arena, plan)
            if moved:
                print(moved)
        print(f"ok: {arena.name} ({arena.file})")
        for line in what_would_run(arena, plan):
            print(f"  {line}")
