"""`arena restart NAME`: end one process of a running arena and start it anew."""

from __future__ import annotations

from typing import Annotated

import typer

from arena.cli._running import RunOption, connect, find


def register(app: typer.Typer) -> None:
    @app.command()
    def restart(
        name: Annotated[str, typer.Argument(help="as `arena ps` shows it")], run: RunOption = None
    ) -> None:
        """Restart one process of a running arena."""
        connect(find(run)).ask(do="restart", name=name)
        print(f"{name}: restart asked; `arena ps` shows how it goes")
