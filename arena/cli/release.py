"""`arena release VEHICLE...`: allow programs to fly a vehicle again after another sender took control.

Control is taken by land-all, the copilot, a ground station or a pilot.
"""

from __future__ import annotations

import time
from typing import Annotated

import typer

from arena.cli._running import RunOption, connect, find, user_name
from arena.errors import RunError
from arena.supervisor import Control
from arena.supervisor.release_task import not_confirmed

_PERIOD_S = 0.1


def register(app: typer.Typer) -> None:
    """Add the command `arena release` to the typer app."""

    @app.command()
    def release(
        vehicles: Annotated[
            list[str],
            typer.Argument(
                metavar="VEHICLE...", help="names of the vehicles that programs are allowed to fly again"
            ),
        ],
        run: RunOption = None,
    ) -> None:
        """Allow programs to arm and fly a vehicle again.

        Needed after land-all, the copilot, a pilot or a ground station took control.
        """
        arena = connect(find(run))
        arena.ask(do="release", vehicles=vehicles, by=user_name())
        results = _wait(arena, vehicles)
        failed = {vehicle: names for vehicle, names in results.items() if names}
        if released := [vehicle for vehicle in vehicles if vehicle not in failed]:
            print(f"{', '.join(released)}: released; programs are allowed to arm and fly again")
        if failed:
            raise RunError("\n".join(not_confirmed(vehicle, names) for vehicle, names in failed.items()))


def _wait(arena: Control, vehicles: list[str]) -> dict[str, list[str]]:
    """Wait until all processes have confirmed the release of each vehicle, or a time limit has passed.

    Return vehicle -> names of the processes that did not confirm; an empty list if programs may fly the vehicle again.
    """
    while True:
        results = arena.ask(do="ps")["releases"]
        if all(results[vehicle] is not None for vehicle in vehicles):
            return {vehicle: results[vehicle] for vehicle in vehicles}
        time.sleep(_PERIOD_S)
