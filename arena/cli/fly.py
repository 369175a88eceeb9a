"""`arena fly`: fly a vehicle of a running arena by hand, or along a trajectory file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arena.cli._running import RunOption


def register(app: typer.Typer) -> None:
    """Add the command `arena fly` to the typer app."""

    @app.command()
    def fly(
        vehicle: Annotated[str, typer.Argument(metavar="VEHICLE", help="name of the vehicle")],
        file: Annotated[
            Path | None,
            typer.Argument(
                metavar="[FILE]",
                help="CSV file with a trajectory or with setpoints; without a file, you fly by hand",
            ),
        ] = None,
        run: RunOption = None,
        gamepad: Annotated[
            bool,
            typer.Option(
                "--gamepad", help="fly with the sticks of a gamepad instead of keys; needs the package pygame"
            ),
        ] = False,
        check: Annotated[
            bool,
            typer.Option(
                "--check", help="only check that the trajectory fits the room and the vehicle; do not fly"
            ),
        ] = False,
        real: Annotated[
            bool,
            typer.Option(
                "--real",
                help="allow the flight of a real vehicle; you must then type the name of the vehicle",
            ),
        ] = False,
    ) -> None:
        """Fly a vehicle of a running arena by hand, with keys or a gamepad, or along a trajectory file: `arena fly uav1 path.csv`."""
        from arena.fly.running_vehicle import find_vehicle

        found = find_vehicle(vehicle, run)
        if found.is_real and not check:
            ask_for_real(found.name, allowed=real)
        if file is None:
            raise SystemExit(_by_hand(found, gamepad=gamepad))
        from arena.fly.follow_file import check_flight, fly_file
        from arena.fly.trajectory_file import read_trajectory

        trajectory = read_trajectory(file)
        if check:
            check_flight(found, trajectory)
            print(f"{file}: ok, the trajectory takes {trajectory.duration_s:.1f} s")
            return
        raise SystemExit(fly_file(found, trajectory, lambda text: print(text, flush=True)))


def _by_hand(vehicle: object, *, gamepad: bool) -> int:
    from arena.fly.by_hand import fly_by_hand
    from arena.fly.gamepad import Gamepad
    from arena.fly.running_vehicle import RunningVehicle

    assert isinstance(vehicle, RunningVehicle)
    return fly_by_hand(vehicle, Gamepad() if gamepad else None)


def ask_for_real(name: str, *, allowed: bool) -> None:
    """Ask the user to type the name of a real vehicle, to confirm the flight.

    Raises InputError for a different answer, and if the option --real is missing.
    """
    from arena.cli._consent import confirm
    from arena.errors import InputError

    if not allowed:
        raise InputError(f"{name} is a real vehicle. Add --real to fly it")
    print(
        f"{name} is a real vehicle. Is the room clear? Is the pilot with the RC transmitter ready?",
        flush=True,
    )
    confirm(name, f"Type {name} to fly: ", subject=name, consequence="Nothing was sent")
