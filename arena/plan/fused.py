"""Fused arena: one process contains the world, motion capture, forwarders, router and recorder. Pure.

This module decides whether a simulated arena is fused, and converts its plan.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from arena.constants import POSE_PAGE
from arena.errors import InputError
from arena.plan.model import Member, ProcessSpec
from arena.plan.tools import named_tools
from arena.schema import Arena

_MEMBERS = frozenset({"mocap", "forward", "router", "sensors", "recorder"})
MODULE, SLICE = "arena.fused", "fused.json"
POSES = "{rt}/poses"
"""Path of the pose page, the shared memory with the captured poses (`arena.wire.pose_page`)."""
# ports that are not opened for vehicles with the built-in autopilot
_IN_MEMORY = ("router link", "vision link", "ground station link")
# autopilots of vehicles whose other parts can share the world's process
_MAY_SHARE = frozenset({"builtin", "px4"})
REAL_TIME_FROM = 5
"""Number of vehicles from which on `processes: auto` chooses one process in real time. docs/architecture.md has the figures."""


def is_fused(arena: Arena) -> bool:
    """Return whether the arena is fused: world, motion capture, forwarders, router and recorder in one process.

    Raises InputError if the YAML asks for one process and this is not possible.
    """
    return not why_many(arena)


def why_many(arena: Arena) -> str:
    """Return why the arena is not fused (its parts run as separate processes); "" if it is fused.

    Raises InputError if the YAML asks for one process and this is not possible.
    """
    asked = arena.sim.processes
    others = [v for v in arena.vehicles if v.autopilot not in _MAY_SHARE]
    if others:
        reason = f"{others[0].name} has autopilot: {others[0].autopilot}, which needs processes of its own"
        if asked == "one":
            raise InputError(f"sim.processes: got `one`, but {reason}. Try `auto` or `many`.")
        return reason
    if asked == "many":
        return "sim.processes is many"
    if asked == "auto" and arena.sim.speed == 1.0:
        return _why_many_in_real_time(arena)
    return ""


def _why_many_in_real_time(arena: Arena) -> str:
    if any(v.autopilot == "px4" for v in arena.vehicles):
        return "in real time an arena with PX4 has the same processes as a real one"
    if len(arena.vehicles) < REAL_TIME_FROM:
        return f"in real time a simulated arena with fewer than {REAL_TIME_FROM} vehicles has the same processes as a real one"
    return ""


def why_one(arena: Arena) -> str:
    """Return why the arena is fused (its parts run in one process). Call this function only for a fused arena."""
    if arena.sim.processes == "one":
        return "sim.processes is one"
    if arena.sim.speed == 1.0:
        return f"in real time {REAL_TIME_FROM} vehicles or more need less CPU time in one process"
    return "an arena that does not run in real time is faster in one process, and repeatable with built-in autopilots"


def could_be_member(process: str) -> bool:
    """Return whether a fused arena runs this process inside the process `world`. Also true for `world` itself.

    These processes are `world` itself, motion capture, forwarders, router and recorder.
    """
    kind = process.partition(".")[0]
    return kind == "world" or kind in _MEMBERS


def fuse(arena: Arena, processes: Sequence[ProcessSpec]) -> tuple[ProcessSpec, ...]:
    """Move motion capture, forwarders, router and recorder into the process `world`. Return the new processes.

    A process that waits for a joined process then also waits for `world`, and for the processes that the joined process
    waited for, such as PX4.
    """
    joined = {p.name: p for p in processes if p.kind in _MEMBERS}
    found = []
    for process in processes:
        if process.kind == "world":
            found.append(_with_members(arena, process, list(joined.values())))
        elif process.name not in joined:
            through = [need for n in process.needs if n in joined for need in ("world", *joined[n].needs)]
            others = [need for need in through if need not in joined]
            found.append(dataclasses.replace(process, needs=tuple(dict.fromkeys((*others, *process.needs)))))
    return tuple(found)


def fused_slices(
    arena: Arena, made: dict[str, dict[str, Any]], processes: Sequence[ProcessSpec]
) -> dict[str, dict[str, Any]]:
    """Return the configuration files (slices) of a fused arena: {file name: content}.

    One more file lists the processes that run inside `world`.

    The world keeps the simulation time stopped until all user programs in Python use the simulation clock. With a copilot the
    world does not wait, because the copilot needs simulation time to become ready. The same holds for MAVROS if a program waits
    for it. In real time the world never waits.

    On the simulation clock, user programs read their captured poses from shared memory (the pose page).
    """
    members = ["world", *(p.name for p in processes if p.kind in _MEMBERS)]
    programs = {
        v.name: f"group.{v.program.group}" if v.program.group else v.name
        for v in arena.vehicles
        if v.program is not None and v.program.is_python
    }
    world = {
        **made["world.json"],
        "expected": []
        if arena.copilot is not None or arena.sim.speed == 1.0 or _program_waits_for_mavros(arena)
        else list(dict.fromkeys(programs.values())),
    }
    fused: dict[str, Any] = {"name": "world", "members": members, "sleepers": {}, "poses": None}
    if arena.sim.speed != 1.0:
        fused |= {"sleepers": programs, "poses": POSES}
        made = {**made, **_programs_with_page(made)}
    return {**made, "world.json": world, SLICE: fused}


def _programs_with_page(made: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the configuration files of the user programs, changed so that they read their poses from shared memory."""
    rows = {body["name"]: row for row, body in enumerate(made["mocap.json"]["bodies"])}
    programs = {file: one for file, one in made.items() if file.startswith("program.")}
    return {
        file: {**one, "capture": {"kind": POSE_PAGE, "path": POSES, "row": rows[one["body"]]}}
        for file, one in programs.items()
    }


def _program_waits_for_mavros(arena: Arena) -> bool:
    mavros = {name for name, tool, _ in named_tools(arena) if tool.mavros is not None}
    return any(mavros.intersection(v.program.needs) for v in arena.vehicles if v.program is not None)


def _with_members(arena: Arena, world: ProcessSpec, joined: Sequence[ProcessSpec]) -> ProcessSpec:
    python = world.argv[0]
    closed = {
        f"{link} of {v.name}" for v in arena.vehicles if v.autopilot == "builtin" for link in _IN_MEMORY
    }
    closed |= {"emulated sensors", *(f"sensors of {v.name}" for v in arena.vehicles)}
    return dataclasses.replace(
        world,
        argv=(python, "-m", MODULE, f"{{run}}/slices/{SLICE}"),
        env=(*world.env, ("PYTHONHASHSEED", "0")),
        stop_timeout_s=max(p.stop_timeout_s for p in (world, *joined)),
        cpu_budget=1.0,
        memory_budget_mb=world.memory_budget_mb + 20.0 * len(joined),
        listens=tuple(x for p in (world, *joined) for x in p.listens if x.what not in closed),
        members=tuple(Member(name=p.name, kind=p.kind, vehicle=p.vehicle) for p in joined),
    )
