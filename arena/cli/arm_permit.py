"""`arena arm-permit VEHICLE...`: allow arming of real vehicles that were connected after the start of the arena.

This includes vehicles that rebooted or reconnected.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Annotated, Any

import typer

from arena.cli._running import RunOption, connect, find, user_name
from arena.errors import RunError

_ANSWER_S = 3.0
_PERIOD_S = 0.1


def register(app: typer.Typer) -> None:
    """Add the command `arena arm-permit` to the typer app."""

    @app.command("arm-permit")
    def arm_permit(
        vehicles: Annotated[
            list[str],
            typer.Argument(metavar="VEHICLE...", help="real vehicles that are allowed to arm from now on"),
        ],
        run: RunOption = None,
    ) -> None:
        """Allow a real vehicle to arm after it was connected, rebooted or reconnected in a running arena.

        A vehicle that was connected at the start of the arena has an arm permit until `arena preflight`, a
        reboot or a reconnection. The program of the vehicle can arm it at once: clear the room first.
        """
        arena = connect(find(run))
        by = f"{user_name()} (arena arm-permit)"
        links = _links(arena.ask(do="ps"))
        for vehicle in vehicles:
            if vehicle in links:
                print(vehicle_line(vehicle, links[vehicle]))
        arena.ask(do="arm_permit", vehicles=vehicles, by=by)
        deadline = time.monotonic() + _ANSWER_S
        waiting = list(vehicles)
        while waiting and time.monotonic() < deadline:
            links = _links(arena.ask(do="ps"))
            waiting = [v for v in waiting if links[v].get("arm_permit") != by]
            time.sleep(_PERIOD_S)
        for vehicle in vehicles:
            if vehicle not in waiting:
                print(f"{vehicle}: is allowed to arm now")
        if waiting:
            raise RunError(
                "\n".join(
                    f"{v}: got no arm permit within {_ANSWER_S:g} s. Is the vehicle switched on and connected? Then run "
                    f"`arena arm-permit {v}` again"
                    for v in waiting
                )
            )


def vehicle_line(vehicle: str, stats: Mapping[str, Any]) -> str:
    """Return one line about a vehicle that gets an arm permit: uid, address, battery and failing checks.

    stats: statistics that the process link.<vehicle> has reported.
    """
    battery = stats.get("battery")
    charge = "battery unknown" if battery is None else f"battery {battery:.0f} %"
    failing = [text for text in stats.get("may_not_arm", ()) if "no arm permit" not in text]
    checks = "; ".join(failing) or "all preflight checks pass"
    where = stats.get("partner") or "not connected"
    return f"{vehicle}: uid {stats.get('uid') or 'unknown'}, {where}, {charge}. {checks}"


def _links(status: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the statistics of each process link.<vehicle>, by vehicle name.

    Each vehicle with a real flight controller has such a process.
    """
    processes = status["processes"].values()
    return {row["vehicle"]: row["stats"] for row in processes if row["kind"] == "link"}
