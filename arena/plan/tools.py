"""Processes of the YAML section `tools`: additional programs, such as the bridge to ROS 2. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from arena.constants import PROCESS_ENV
from arena.plan import slices
from arena.plan.job import Json
from arena.plan.model import ProcessSpec, Restart
from arena.plan.process_table import required_copilot
from arena.schema import Arena, Vehicle
from arena.schema.placeholders import filled, variables
from arena.schema.tools import MODULES, ROS2_SLICE, Ready, Ros2, Tool

VIEWER_NICE = 10
"""Nice value of arena's own tools, such as the page of `arena monitor`: vehicles and programs have priority."""


def named_tools(arena: Arena) -> Iterator[tuple[str, Tool, Vehicle | None]]:
    """Yield (process name, tool, vehicle) of every tool. The vehicle is None for a tool of the whole arena."""
    for name, tool in arena.tools.items():
        yield f"tool.{name}", tool, None
    for v in arena.vehicles:
        for name, tool in v.tools.items():
            yield f"tool.{v.name}.{name}", tool, v


def tools(arena: Arena, python: str) -> Iterator[ProcessSpec]:
    """Yield the `ProcessSpec` of each tool, a program that the YAML lists under `tools`.

    python: path of the Python interpreter for arena's own tools.
    """
    for name, tool, vehicle in named_tools(arena):
        own = tool.argv[0] in MODULES
        argv = tuple(filled(text, arena, vehicle) for text in tool.argv)
        env = tuple((key, filled(text, arena, vehicle)) for key, text in sorted(tool.env.items()))
        yield ProcessSpec(
            name=name,
            kind="tool",
            vehicle=None if vehicle is None else vehicle.name,
            argv=(python, "-m", *argv) if own else argv,
            nice=VIEWER_NICE if own and tool.ros2 is None else 0,
            cwd=str(Path(arena.folder) / (tool.cwd or "")),
            env=(*PROCESS_ENV, *variables(arena, vehicle), *_domain(arena, tool), *env),
            needs=("router", *required_copilot(arena)) if tool.needs is None else tool.needs,
            restart=Restart(mode=tool.restart),
            stopped_for_s=None,
            **_readiness(arena, vehicle, tool),
        )


def _domain(arena: Arena, tool: Tool) -> tuple[tuple[str, str], ...]:
    """Return ROS_DOMAIN_ID for a ROS 2 tool as an environment variable, or () if the YAML sets no domain.

    A domain of the tool itself comes first, then that of the bridge or the agent of the arena.
    """
    settings = tool.microxrce or tool.mavros or tool.bag
    if settings is None:
        return ()
    of_arena = (each.ros2 or each.microxrce for each in arena.tools.values())
    found = [s.domain for s in (settings, *of_arena) if s is not None and s.domain is not None]
    return (("ROS_DOMAIN_ID", str(found[0])),) if found else ()


def _readiness(arena: Arena, vehicle: Vehicle | None, tool: Tool) -> dict[str, Any]:
    """Return the fields of `ProcessSpec` that define when a tool is ready."""
    ready = tool.ready
    if ready is None:
        return {"ready": "reported" if tool.ros2 is not None else "started"}
    found: dict[str, Any] = {"ready": kind_of(ready), "start_timeout_s": ready.timeout_s}
    if ready.port is not None:
        return {**found, "ready_port": ready.port}
    if ready.file is not None:
        folder = Path(arena.folder) / (tool.cwd or "")
        name = filled(ready.file, arena, vehicle)
        return {**found, "ready_value": name if name.startswith("{run}") else str(folder / name)}
    if ready.delay_s is not None:
        return {
            **found,
            "ready_value": f"{ready.delay_s:g}",
            "start_timeout_s": ready.delay_s + ready.timeout_s,
        }
    return {**found, "ready_value": ready.log}


def kind_of(ready: Ready) -> str:
    """Return the kind of a tool's readiness probe: log, port, file or delay."""
    kinds = {"log": ready.log, "port": ready.port, "file": ready.file, "delay": ready.delay_s}
    return next(kind for kind, value in kinds.items() if value is not None)


def tool_slices(arena: Arena) -> dict[str, Json]:
    """Return the configuration files (slices) of arena's own tools, as {file name: content}."""
    settings = [tool.ros2 for tool in arena.tools.values() if tool.ros2 is not None]
    return {ROS2_SLICE: _ros2(arena, settings[0])} if settings else {}


def _ros2(arena: Arena, settings: Ros2) -> Json:
    """Return the configuration (slice) of the bridge to ROS 2."""
    agent = any(tool.microxrce is not None for tool in arena.tools.values())
    captures = (
        slices.capture(
            arena, [v.mocap_body for v in arena.vehicles if v.simulated is simulated], simulated=simulated
        )
        for simulated in (True, False)
        if any(v.simulated is simulated for v in arena.vehicles)
    )
    return {
        "name": "tool.ros2",
        "domain": settings.domain,
        "address": settings.address or "127.0.0.1",
        "rate_hz": settings.rate_hz,
        "setpoints": settings.setpoints,
        "clock": None if arena.hardware else slices.CLOCK,
        "captures": [c for c in captures if c is not None],
        "vehicles": [
            {
                "name": v.name,
                "id": v.id,
                "body": v.mocap_body,
                "tools": [arena.address, v.ports.tools],
                "px4_msgs": settings.px4_msgs and not (agent and v.autopilot == "px4"),
            }
            for v in arena.vehicles
        ],
    }
