"""`arena preflight VEHICLE...`: check that motion capture tracks the right rigid body for a real vehicle.

A person moves the vehicle as the command prints it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Annotated, Any

import typer

from arena.cli._running import RunOption, connect, find, user_name
from arena.errors import RunError
from arena.supervisor import Control

_ANSWER_S = 5.0
_PERIOD_S = 0.1
_UNCHANGED_S = 90.0  # the check itself allows 60 s for a step


def register(app: typer.Typer) -> None:
    """Add the command `arena preflight` to the typer app."""

    @app.command()
    def preflight(
        vehicles: Annotated[
            list[str],
            typer.Argument(metavar="VEHICLE...", help="real vehicles to check, one after the other"),
        ],
        run: RunOption = None,
    ) -> None:
        """Check that motion capture tracks the right rigid body for a real vehicle.

        A person lifts and tilts the vehicle. The command prints each step: lift the vehicle, tilt it nose
        down, then right side down. The motion also shows whether the axes of the rigid body are right. The
        vehicle must be disarmed and cannot be armed during the check. It needs a new arm permit afterwards,
        because somebody stood beside it. Real vehicles need this check after each start of their autopilot
        (`preflight.axes_check`). It also measures the delay of the poses and proposes EKF2_EV_DELAY.
        """
        arena = connect(find(run))
        results = {vehicle: _check(arena, vehicle) for vehicle in vehicles}
        if passed := [vehicle for vehicle, good in results.items() if good]:
            print(f"Leave the room, then run `arena arm-permit {' '.join(passed)}`", flush=True)
        failed = [vehicle for vehicle, good in results.items() if not good]
        if failed:
            raise RunError(f"{', '.join(failed)}: the identity and axes check has failed")


def _check(arena: Control, vehicle: str) -> bool:
    """Run the identity and axes check of one vehicle on the terminal. Return whether the check has passed.

    Prints what the person must do, and the result.
    """
    by = f"{user_name()} (arena preflight)"
    before = _status(arena, vehicle).get("number")
    arena.ask(do="preflight", vehicle=vehicle, by=by)
    status = _started(arena, vehicle, before)
    try:
        status = _guide(arena, vehicle, status)
    except KeyboardInterrupt:
        arena.ask(do="preflight", vehicle=vehicle, by=by, stop=True)
        raise
    print(f"{vehicle}: {status['state']}")
    for line in status["lines"]:
        print(f"{vehicle}:   {line}", flush=True)
    return bool(status["state"] == "passed")


def _started(arena: Control, vehicle: str, before: object) -> Mapping[str, Any]:
    """Wait until the process link.<vehicle> reports the start of a check. Return the status of the check.

    before: number of the vehicle's previous check, which may still be reported; None if there was none.
    Raises RunError if no new check is reported within 5 s.
    """
    deadline = time.monotonic() + _ANSWER_S
    while time.monotonic() < deadline:
        status = _status(arena, vehicle)
        if status.get("number") not in (None, before):
            return status
        time.sleep(_PERIOD_S)
    raise RunError(
        f"{vehicle}: the process link.{vehicle} has not started the check within {_ANSWER_S:g} s: look at `arena ps`"
    )


def _guide(arena: Control, vehicle: str, status: Mapping[str, Any]) -> Mapping[str, Any]:
    """Print instructions for the person who moves the vehicle, until the check ends. Return the final status."""
    number, shown, since = status["number"], "", time.monotonic()
    while status["state"] == "running":
        if status["text"] != shown:
            shown, since = status["text"], time.monotonic()
            print(f"{vehicle}: {shown}", flush=True)
        if time.monotonic() - since > _UNCHANGED_S:
            raise RunError(
                f"{vehicle}: the process link.{vehicle} has reported nothing new for {_UNCHANGED_S:g} s: look at `arena ps`"
            )
        time.sleep(_PERIOD_S)
        status = _status(arena, vehicle)
        if status.get("number") != number:
            raise RunError(
                f"{vehicle}: the check was lost, because the process link.{vehicle} was restarted or another check was started. "
                f"Run `arena preflight {vehicle}` again"
            )
    return status


def _status(arena: Control, vehicle: str) -> Mapping[str, Any]:
    """Return the status of the newest axes check of a vehicle, as reported by link.<vehicle>; {} if none."""
    for row in arena.ask(do="ps")["processes"].values():
        if row["kind"] == "link" and row["vehicle"] == vehicle:
            return row["stats"].get("axes_check") or {}
    return {}
