"""`arena shell`: opens a Python shell that is connected to a vehicle of a running arena."""

from __future__ import annotations

from typing import Annotated

import typer

from arena.cli._running import RunOption


def register(app: typer.Typer) -> None:
    """Add the command `arena shell` to the typer app."""

    @app.command()
    def shell(
        vehicle: Annotated[
            str | None,
            typer.Argument(
                metavar="[VEHICLE]",
                help="name of the vehicle; can be omitted if the arena has only one vehicle",
            ),
        ] = None,
        run: RunOption = None,
        real: Annotated[
            bool,
            typer.Option(
                "--real",
                help="allow the control of a real vehicle; you must then type the name of the vehicle",
            ),
        ] = False,
    ) -> None:
        """Open a Python shell (IPython if installed) with `uav`, a vehicle of a running arena.

        Leaving the shell lands the vehicle.
        """
        from arena.cli.fly import ask_for_real
        from arena.fly.connect import Session
        from arena.fly.running_vehicle import find_vehicle, lock_pilot
        from arena.fly.shell import interact

        found = find_vehicle(vehicle, run)
        if found.is_real:
            ask_for_real(found.name, allowed=real)
        with lock_pilot(found), Session(found) as session:
            interact(session)
