"""`arena restart NAME`: stop one process of a running arena and start it again."""

from __future__ import annotations

from typing import Annotated

import typer

from arena.cli._running import RunOption, connect, find


def register(app: typer.Typer) -> None:
    """Add the command `arena restart` to the typer app."""

    @app.command()
    def restart(
        name: Annotated[str, typer.Argument(help="name of the process, as `arena ps` shows it")],
        run: RunOption = None,
        yes: Annotated[
            bool,
            typer.Option("--yes", help="restart even if a vehicle that depends on the process may be flying"),
        ] = False,
    ) -> None:
        """Restart one process of a running arena.

        The option --yes is required if a flying vehicle depends on the process. The world cannot be restarted alone, because
        all other processes use its clock.
        """
        connect(find(run)).ask(do="restart", name=name, yes=yes)
        print(f"{name}: restart requested; `arena ps` shows its state")
