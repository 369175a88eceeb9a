"""`arena arm-permit VEHICLE...`: allow arming of real vehicles that were connected after the start of the arena.

This includes vehicles that rebooted or reconnected.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import typer

from arena.cli._running import RunOption, connect, find, user_name
from arena.errors import RunError
from arena.supervisor import Control

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
        _request(arena, vehicles, by)


def _request(arena: Control, vehicles: Sequence[str], by: str) -> None:
    """Request arm permits, and print for each vehicle whether it got the permit.

    by: who requests the permits. Raises RunError with the reason of each vehicle that got none.
    """
    before = {vehicle: _answer(stats).get("number") for vehicle, stats in _links(arena.ask(do="ps")).items()}
    arena.ask(do="arm_permit", vehicles=list(vehicles), by=by)
    deadline = time.monotonic() + _ANSWER_S
    answers: dict[str, Mapping[str, Any]] = {}
    while len(answers) < len(set(vehicles)) and time.monotonic() < deadline:
        links = _links(arena.ask(do="ps"))
        for vehicle in vehicles:
            answer = _answer(links[vehicle])
            if answer.get("number") not in (None, before.get(vehicle)) and answer["by"] == by:
                answers[vehicle] = answer
        time.sleep(_PERIOD_S)
    refused = []
    for vehicle in vehicles:
        if vehicle not in answers:
            refused.append(
                f"{vehicle}: got no arm permit within {_ANSWER_S:g} s. Is the vehicle switched on and connected? Then run "
                f"`arena arm-permit {vehicle}` again"
            )
        elif why := answers[vehicle]["refusal"]:
            refused.append(
                f"{vehicle}: got no arm permit: {why}. Run `arena arm-permit {vehicle}` again when this has changed"
            )
        else:
            print(f"{vehicle}: is allowed to arm now")
    if refused:
        raise RunError("\n".join(refused))


def _answer(stats: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the answer of the process link.<vehicle> to the last request for an arm permit; {} if none."""
    return stats.get("arm_permit_answer") or {}


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
