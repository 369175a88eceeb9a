"""`arena forget VEHICLE`: declare a real vehicle dead. The run then ends without waiting for this vehicle."""

from __future__ import annotations

from typing import Annotated

import typer

from arena.cli._consent import confirm
from arena.cli._running import RunOption, connect, find, user_name


def register(app: typer.Typer) -> None:
    """Add the command `arena forget` to the typer app."""

    @app.command()
    def forget(
        vehicle: Annotated[str, typer.Argument(help="real vehicle that has crashed or was unplugged")],
        run: RunOption = None,
        yes: Annotated[bool, typer.Option("--yes", help="do not ask for confirmation")] = False,
    ) -> None:
        """Declare a real vehicle dead: the run does not wait until the vehicle is disarmed.

        Refused while the vehicle reports that it is armed.
        """
        control = connect(find(run))
        facts = control.ask(do="ps")["facts"]
        if not yes:
            _confirm(vehicle, facts.get(f"{vehicle}.armed"), facts.get(f"{vehicle}.connected"))
        control.ask(do="forget", vehicle=vehicle, by=user_name())
        print(f"{vehicle}: declared dead. The run can end without its landing")


def _confirm(vehicle: str, armed: bool | None, connected: bool | None) -> None:
    """Ask the user to type the name of the vehicle, to confirm that the vehicle is dead.

    Raises InputError for a different answer, or if stdin is not a terminal.

    armed, connected: last reports of the vehicle; None if there is none.
    """
    state = {True: "armed", False: "disarmed", None: "unknown"}[armed]
    telemetry = {True: "it still arrives", False: "none arrives now", None: "none in this run"}[connected]
    print(f"{vehicle} was last reported as {state} (telemetry: {telemetry}).")
    print("Look at the vehicle: are its motors stopped, or is its battery unplugged?", flush=True)
    confirm(
        vehicle,
        f"Type {vehicle} to declare it dead: ",
        subject="`arena forget`",
        consequence="Nothing was changed",
    )
