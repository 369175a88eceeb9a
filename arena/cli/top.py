"""`arena top`: live view of a running arena in the terminal."""

from __future__ import annotations

from typing import Annotated

import typer

from arena.cli._running import RunOption


def register(app: typer.Typer) -> None:
    """Add the command `arena top` to the typer app."""

    @app.command()
    def top(
        run: RunOption = None,
        once: Annotated[bool, typer.Option("--once", help="print the view once as text and exit")] = False,
    ) -> None:
        """Show the vehicles, processes and events of a running arena live in the terminal. The key q quits."""
        from arena.top.screen import print_once, watch

        if once:
            print_once(run)
        else:
            watch(run)
