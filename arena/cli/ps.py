"""`arena ps`: the processes and vehicles of a running arena."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from arena.cli._running import RunOption, connect, find


def register(app: typer.Typer) -> None:
    """Add the command `arena ps` to the typer app."""

    @app.command()
    def ps(
        run: RunOption = None,
        as_json: Annotated[bool, typer.Option("--json", help="print JSON for other programs")] = False,
    ) -> None:
        """Show the vehicles and processes of a running arena."""
        state = find(run)
        status = connect(state).ask(do="ps")
        if as_json:
            print(json.dumps(status, indent=1))
            return
        from rich.console import Console

        from arena.supervisor.status_tables import status_view

        Console().print(status_view(status))
        print(f"run folder: {Path(state.run)}")
        if status.get("replay"):
            print(f"replayed from: {status['replay']}")
