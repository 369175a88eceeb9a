"""Functions that several commands use: choice of a free address, text about an arena.

This module does not import typer, because a plain `arena check` does without it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from arena.builtin_parameters import effect_problem

if TYPE_CHECKING:
    from arena.plan import Plan
    from arena.schema import Arena


def at_free_address(arena: Arena, plan: Plan, overrides: Sequence[str]) -> tuple[Arena, Plan, str]:
    """Give an arena the first free loopback address if its own address is in use.

    Returns (arena, plan of its processes, reason for the new address). The reason is "" if the address was not changed.

    The address is not changed if the YAML or the command line sets it, or if the arena has a real flight controller,
    because two arenas must not command the same vehicle.
    overrides: `key=value` texts of `--set`.
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
    """Return lines of text that describe what `arena up` would start.

    The lines contain the vehicles, notes, ports that other computers can reach, and the number of processes.
    """
    from arena.plan.open_ports import open_lines

    lines = [_vehicle_line(arena, v.name) for v in plan.vehicles]
    lines += (
        not_possible(arena)
        + without_effect(arena)
        + clock_notes(arena)
        + copilot_notes(arena)
        + open_lines(plan)
    )
    programs = sum(p.is_program for p in plan.processes)
    lines.append(f"{len(plan.processes)} processes, {programs} of them user programs")
    return [*lines, _how_many(arena, plan)] if arena.simulated else lines


def _how_many(arena: Arena, plan: Plan) -> str:
    """Return a line about the number of processes of the simulation: one (a fused arena) or several, and why."""
    from arena.plan.fused import why_many, why_one

    members = [member.name for spec in plan.processes if spec.kind == "world" for member in spec.members]
    if members:
        return f"the process world contains {', '.join(members)}: {why_one(arena)}"
    return f"world, motion capture, pose forwarders, router and recorder are separate processes: {why_many(arena)}"


def not_possible(arena: Arena) -> list[str]:
    """Return a line for each setting of the YAML that a vehicle's PX4 version does not support.

    Another line names the values of a `params_file` that are not used.
    """
    from arena.plan.firmware import all_firmware, replaced_text

    found = []
    for name, each in all_firmware(arena).items():
        found += [f"{name}: not possible: {x}" for x in each.not_possible]
        found += [f"{name}: {replaced_text(each.replaced)}"] if each.replaced else []
    return found


def without_effect(arena: Arena) -> list[str]:
    """Return a line for each PX4 parameter of the YAML that has no effect in the built-in autopilot.

    The vehicle does not fly PX4. The built-in autopilot of the simulation has only some of PX4's parameters.
    The parameters of a `params_file` are only counted, because such a file usually contains all parameters of
    a PX4.
    """
    found = []
    for v in arena.vehicles:
        counted = 0
        for name, value in v.own_params.items() if v.autopilot == "builtin" else ():
            why = effect_problem(name, value)
            if why and arena.source.given(arena.source.layer(v.name, "params", name)):
                source = arena.origins[f"vehicles.{v.name}.params.{name}"].source
                found.append(f"{v.name}: {name} has no effect ({source}): {why}")
            elif why:
                counted += 1
        if counted:
            found.append(
                f"{v.name}: {counted} parameters of its params_file have no effect in the built-in autopilot"
            )
    return found


def clock_notes(arena: Arena) -> list[str]:
    """Return a note if `sim.speed` of the YAML is ignored, because a user program uses the wall clock.

    The list is empty if the user asked for no other speed.
    """
    from arena.schema.resolve import wall_clock_programs

    asked, programs = arena.source.value(("sim", "speed")), wall_clock_programs(arena.vehicles)
    if not programs or asked in (None, 1):
        return []
    return [
        f"sim.speed is 1 instead of {asked}: the program of {programs[0]} uses the wall clock. If it follows simulation time, "
        "write `program: {path: ..., clock: simulation}`"
    ]


def copilot_notes(arena: Arena) -> list[str]:
    """Return warnings about the copilot's settings, for the terminal.

    The copilot commands vehicles to hold or land when they violate a rule. There is a note if real vehicles
    have no copilot, and for two simulated vehicles that start closer to each other than
    `copilot.separation.at_m`.
    """
    if arena.copilot is None:
        names = ", ".join(v.name for v in arena.hardware)
        return [f"{names}: real vehicles without a copilot: add `copilot: {{}}` to the YAML"] if names else []
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
