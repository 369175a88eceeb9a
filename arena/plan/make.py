"""`make_plan`: Arena -> Plan. Pure: the same arena and interpreter always give the same plan."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from arena.plan.checks import check_arena
from arena.plan.firmware import all_firmware
from arena.plan.fused import fuse, fused_slices, is_fused
from arena.plan.job import Job, link_of
from arena.plan.model import Plan, ProcessSpec, Restart, VehiclePlan
from arena.plan.process_table import ENV, TABLE, jobs, listens, process_spec, required_copilot
from arena.plan.resolved_yaml import arena_yaml
from arena.schema import Arena, Vehicle
from arena.schema.models import Tool


def make_plan(arena: Arena, python: str = sys.executable) -> Plan:
    """Return the plan of an arena: its processes with their configuration files, in start order.

    python: path of the Python interpreter for arena's processes and `.py` programs.
    Raises InputError with every problem of PX4 parameters, PX4 versions and the needs of tools.
    """
    check_arena(arena, process_names(arena))
    job = Job(arena=arena, fleet=all_firmware(arena), python=python)
    processes = (*(process_spec(row, each) for row in TABLE for each in jobs(row, job)), *_tools(arena))
    made = dict(_slices(job))
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
            (python, "-m", "arena.emergency.land_all", "--run", "{run}"),
            listens=tuple(listens(arena, "task", None)),
        ),
        report=_task(
            "report",
            (python, "-m", "arena.recorder.report", "{run}"),
            nice=10,
            cpu_budget=1.0,
            memory_budget_mb=500.0,
        ),
        yaml=arena_yaml(arena, job.fleet),
    )


def process_names(arena: Arena) -> list[str]:
    """Return the names of the arena's processes in start order."""
    job = Job(arena=arena, fleet={}, python="")
    names = [row.name(each) for row in TABLE for each in jobs(row, job)]
    return names + [name for name, _, _ in _named_tools(arena)]


def _slices(job: Job) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield (file name, content) of the JSON configuration (slice) of each process that has one.

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
        logger_port=v.ports.logger,
        mocap_body=v.mocap_body,
        radio=v.radio,
        axes_check=arena.preflight.axes_check if v.forward and not v.simulated else "",
    )


def _named_tools(arena: Arena) -> Iterator[tuple[str, Tool, str | None]]:
    for name, tool in arena.tools.items():
        yield f"tool.{name}", tool, None
    for v in arena.vehicles:
        for name, tool in v.tools.items():
            yield f"tool.{v.name}.{name}", tool, v.name


def _tools(arena: Arena) -> Iterator[ProcessSpec]:
    for name, tool, vehicle in _named_tools(arena):
        yield ProcessSpec(
            name=name,
            kind="tool",
            vehicle=vehicle,
            argv=tool.argv,
            cwd=str(Path(arena.folder) / (tool.cwd or "")),
            env=(*ENV, *sorted(tool.env.items())),
            needs=("router", *required_copilot(arena)) if tool.needs is None else tool.needs,
            ready="started",
            restart=Restart(mode=tool.restart),
            stopped_for_s=None,
        )


def _task(name: str, argv: tuple[str, ...], **more: Any) -> ProcessSpec:
    return ProcessSpec(name=name, kind="task", argv=argv, env=ENV, ready="started", **more)
