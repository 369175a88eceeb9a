"""`arena restart NAME`: end one process of a running arena and start it again."""

from __future__ import annotations

from typing import Annotated

import typer

from arena.cli._running import RunOption, connect, find


def register(app: typer.Typer) -> None:
    """Add the verb to the app."""

    @app.command()
    def restart(
        name: Annotated[str, typer.Argument(help="as `arena ps` shows it")],
        run: RunOption = None,
        yes: Annotated[
            bool,
            typer.Option("--yes", help="also when a vehicle that depends on the process may be flying"),
        ] = False,
    ) -> None:
        """Restart one process of a running arena. Refused in flight for what a vehicle depends on, unless --yes."""
        connect(find(run)).ask(do="restart", name=name, yes=yes)
        print(f"{name}: restart requested; `arena ps` shows its state")
