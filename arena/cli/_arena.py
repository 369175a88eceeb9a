"""Options of the verbs that read an arena, and the lines that describe it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from arena.plan import Plan
    from arena.schema import Arena

File = Annotated[Path, typer.Argument(help="the arena's YAML, or its folder")]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override one value of the YAML")
]


def at_free_address(arena: Arena, plan: Plan, overrides: Sequence[str]) -> tuple[Arena, Plan, str]:
    """Return the arena and its plan at the first free loopback address, and a sentence when that is not the default.

    An arena whose YAML or command line names an address keeps it, and so does one with a real flight controller: two
    arenas must not command the same vehicle.
    """
    if arena.source.given(("address",)) or any(v.wire is not None for v in arena.vehicles):
        return arena, plan, ""
    from arena.plan import make_plan
    from arena.plan.machine import Machine, choose_address
    from arena.schema import load_arena
    from arena.supervisor import active_runs

    runs = {run.address: f"run {run.run}" for run in active_runs() if run.live}
    choice = choose_address(plan, runs, Machine())
    if not choice.why:
        return arena, plan, ""
    moved = load_arena(arena.file, [*overrides, f"address={choice.address}"])
    return moved, make_plan(moved), choice.why


def what_would_run(arena: Arena, plan: Plan) -> list[str]:
    """Return a line per vehicle, the ports that other computers reach, and the number of processes."""
    from arena.plan.open_ports import open_lines

    lines = [_vehicle_line(arena, v.name) for v in plan.vehicles]
    lines += not_possible(arena) + copilot_notes(arena) + open_lines(plan)
    programs = sum(p.kind == "program" for p in plan.processes)
    return [*lines, f"{len(plan.processes)} processes, {programs} of them programs"]


def not_possible(arena: Arena) -> list[str]:
    """Return a line for each wish of the YAML that the vehicle's PX4 version has no parameter for."""
    from arena.plan.firmware import all_firmware

    return [
        f"{name}: not possible: {x}" for name, each in all_firmware(arena).items() for x in each.not_possible
    ]


def copilot_notes(arena: Arena) -> list[str]:
    """Return notes on hardware without a copilot, and on vehicles that start closer than the copilot allows."""
    if arena.copilot is None:
        names = ", ".join(v.name for v in arena.hardware)
        return [f"no copilot watches {names}: add `copilot: {{}}` to the YAML"] if names else []
    rule, found = arena.copilot.separation, []
    for a, b in itertools.combinations(arena.simulated, 2) if rule.do != "none" else ():
        if (apart := math.dist(a.position, b.position)) < rule.at_m:
            said = f"{a.name} and {b.name} start {apart:.2f} m apart, and copilot.separation.at_m is {rule.at_m:g}"
            found.append(f"{said}: {b.name} will be held")
    return found


def _vehicle_line(arena: Arena, name: str) -> str:
    v = arena.vehicle(name)
    found = f"{arena.px4.words}, {arena.px4.source}" if arena.px4 else "no PX4 was found"
    auto = f"{v.asked}: " if v.asked != v.autopilot else ""
    asked = f" ({auto}{found})" if auto or v.autopilot == "px4" else ""
    flies = Path(v.program.path).name if v.program else "no program"
    if v.wire is not None and not v.simulated:
        return f"{v.name}: id {v.id}, {v.profile.name}, HARDWARE on {v.wire}, port {v.ports.program}, {flies}"
    if v.wire is not None:
        asked = f" on {v.wire}"
    n, e, d = v.position
    what = f"id {v.id}, {v.profile.name}, autopilot {v.autopilot}{asked}"
    return f"{v.name}: {what}, at N {n:g} E {e:g} D {d:g}, port {v.ports.program}, {flies}"
