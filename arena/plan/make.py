"""`make_plan`: converts an `Arena` (the checked YAML) to a `Plan` (all processes of a run). Pure.

The same arena and interpreter always give the same plan.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from typing import Any

from arena.constants import LAND_TIMEOUT_S, PROCESS_ENV
from arena.plan.checks import check_arena
from arena.plan.firmware import all_firmware
from arena.plan.fused import fuse, fused_slices, is_fused
from arena.plan.job import Job, link_of
from arena.plan.model import Plan, ProcessSpec, VehiclePlan
from arena.plan.process_table import TABLE, jobs, listens, process_spec
from arena.plan.resolved_yaml import arena_yaml
from arena.plan.tools import named_tools, tool_slices, tools
from arena.plan.view_slice import NAME, view
from arena.schema import Arena, Vehicle
from arena.simulation_speed import slowdown


def make_plan(arena: Arena, python: str = sys.executable) -> Plan:
    """Return the plan of an arena: its processes in start order, with their configuration files.

    python: path of the Python interpreter for arena's processes and `.py` programs.
    Raises InputError with every problem of PX4 parameters, PX4 versions and the needs of tools.
    """
    check_arena(arena, process_names(arena))
    job = Job(arena=arena, fleet=all_firmware(arena), python=python)
    processes = (
        *(process_spec(row, each) for row in TABLE for each in jobs(row, job)),
        *tools(arena, python),
    )
    made = {**dict(_slices(job)), NAME: view(arena), **tool_slices(arena)}
    if is_fused(arena):
        made, processes = fused_slices(arena, made, processes), fuse(arena, processes)
    return Plan(
        name=arena.name,
        address=arena.address,
        vehicles=tuple(_vehicle(arena, v) for v in arena.vehicles),
        processes=processes,
        slices=made,
        land=_task(
            "land",
            (python, "-m", "arena.emergency.land_all", "--run", "{run}", *_land_timeout(arena)),
            listens=tuple(listens(arena, "task", None)),
        ),
        report=_task(
            "report",
            (python, "-m", "arena.report", "{run}"),
            nice=10,
            cpu_budget=1.0,
            memory_budget_mb=500.0,
        ),
        yaml=arena_yaml(arena, job.fleet),
    )


def _land_timeout(arena: Arena) -> tuple[str, ...]:
    """Return the option --timeout of the land task for a simulation that is slower than real time."""
    slow = slowdown(arena.sim.speed) if arena.simulated else 1.0
    return ("--timeout", f"{slow * LAND_TIMEOUT_S:g}") if slow > 1.0 else ()


def without_report(plan: Plan) -> Plan:
    """Return a copy of the plan that writes only CSV logs after the run, without a summary and plots."""
    argv = (sys.executable, "-m", "arena.flight_log", "{run}")
    return dataclasses.replace(
        plan, report=_task("logs", argv, nice=10, cpu_budget=1.0, memory_budget_mb=300.0)
    )


def process_names(arena: Arena) -> list[str]:
    """Return the names of the arena's processes in start order."""
    job = Job(arena=arena, fleet={}, python="")
    names = [row.name(each) for row in TABLE for each in jobs(row, job)]
    return names + [name for name, _, _ in named_tools(arena)]


def _slices(job: Job) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield (file name, content) of the configuration file (slice) of each process that has one.

    A vehicle without a program gets the program's file, too, because the user may start a program by hand.
    """
    for row in TABLE:
        if row.slice is None:
            continue
        all_vehicles = [dataclasses.replace(job, vehicle=v) for v in job.arena.vehicles]
        for each in all_vehicles if row.kind == "program" else jobs(row, job):
            yield f"{row.name(each)}.json", row.slice(each)


def _vehicle(arena: Arena, v: Vehicle) -> VehiclePlan:
    return VehiclePlan(
        name=v.name,
        id=v.id,
        autopilot=v.autopilot,
        profile=v.profile.name,
        simulated=v.simulated,
        router=link_of(arena, v, "router"),
        vision=link_of(arena, v, "vision"),
        panic=link_of(arena, v, "panic"),
        port=v.ports.program,
        sdk_port=v.ports.sdk,
        tools_port=v.ports.tools,
        mocap_body=v.mocap_body,
        radio=v.radio,
        axes_check=arena.preflight.axes_check if v.forward and not v.simulated else "",
    )


def _task(name: str, argv: tuple[str, ...], **more: Any) -> ProcessSpec:
    return ProcessSpec(name=name, kind="task", argv=argv, env=PROCESS_ENV, ready="started", **more)
