"""`arena release VEHICLE...`: allow programs to fly a vehicle again, after land-all, the copilot or a pilot took control of it."""

from __future__ import annotations

from typing import Annotated

import typer

from arena.cli._running import RunOption, connect, find, user_name


def register(app: typer.Typer) -> None:
    """Add the command `arena release` to the typer app."""

    @app.command()
    def release(
        vehicles: Annotated[list[str], typer.Argument(metavar="VEHICLE...", help="vehicles to release")],
        run: RunOption = None,
    ) -> None:
        """Allow programs to arm and fly a vehicle again, after land-all, the copilot, a pilot or a ground station took control."""
        connect(find(run)).ask(do="release", vehicles=vehicles, by=user_name())
        print(f"{', '.join(vehicles)}: released; programs are allowed to arm and fly again")
