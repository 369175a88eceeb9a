"""`make_plan`: Arena -> Plan. Pure: the same arena and interpreter always give the same plan."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from arena.mocap.vendors import vendor_settings
from arena.plan import rooms
from arena.plan.copilot import copilot
from arena.plan.firmware import Fleet, all_firmware
from arena.plan.model import Kind, Listen, Plan, ProcessSpec, Restart, VehiclePlan
from arena.plan.text import arena_yaml
from arena.schema import Arena, Vehicle
from arena.schema.models import Tool
from arena.schema.ports import COPILOT, LINK_BASE

# numpy's own threads would steal the second core from the arena
ENV = (("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1"), ("PYTHONUNBUFFERED", "1"))

# Nice values, added to that of the caller. While thirty processes start at once on two cores, programs and loggers leave the
# CPU to what carries simulated time, poses and messages. No process takes a higher priority than the caller's, unless
# `sim.realtime` asks for it, or hardware flies and a copilot watches it. Where the system refuses, the caller's value stays.
NICE_PROGRAM, NICE_LOGGER = 2, 6
NICE_WORLD_REALTIME, NICE_COPILOT_FIRST = -10, -5

# A real vehicle may be switched on long after the arena: what waits for it says so meanwhile.
REAL_START_TIMEOUT_S = 600.0

# With real vehicles a copilot that hangs is as good as none. In a simulated arena it sleeps on a clock that may stand still.
COPILOT_SILENT_S = 5.0

# kind -> (module, cpu budget [cores], memory budget [MB], further fields)
_ROOMS: dict[str, tuple[str, float, float, dict[str, Any]]] = {
    "world": ("arena.sim", 0.8, 400.0, {"restart": Restart(), "start_timeout_s": 60.0}),
    # stopped, it is left alone: its PX4 goes on flying, and would fall with it
    "px4": ("arena.px4", 0.3, 150.0, {"restart": Restart(), "start_timeout_s": 60.0, "stopped_for_s": None}),
    "link": ("arena.fcu_link", 0.2, 120.0, {}),
    "mocap": ("arena.mocap.emulator", 0.3, 150.0, {}),
    "forward": ("arena.pose_forwarder", 0.1, 120.0, {}),
    "router": ("arena.mavlink_router", 0.4, 120.0, {}),
    "copilot": ("arena.copilot", 0.4, 150.0, {}),
    "logger": ("arena.recorder", 0.15, 200.0, {"nice": NICE_LOGGER, "stop_timeout_s": 10.0}),
}


def make_plan(arena: Arena, python: str = sys.executable) -> Plan:
    """python: the interpreter that runs the rooms and the `.py` programs."""
    fleet = all_firmware(arena)
    slices = dict(_slices(arena, fleet))
    return Plan(
        name=arena.name,
        address=arena.address,
        vehicles=tuple(_vehicle(arena, v) for v in arena.vehicles),
        processes=tuple(_processes(arena, python)),
        slices={f"{name}.json": slice_ for name, slice_ in slices.items()},
        land=_land(arena, python),
        report=_task(
            "report",
            (python, "-m", "arena.recorder.report", "{run}"),
            nice=10,
            cpu_budget=1.0,
            memory_budget_mb=500.0,
        ),
        yaml=arena_yaml(arena, fleet),
    )


def _slices(arena: Arena, fleet: Fleet) -> Iterator[tuple[str, dict[str, Any]]]:
    made = [rooms.world(arena, fleet), rooms.mocap(arena)] if arena.simulated else []
    made += [rooms.router(arena)]
    made += [copilot(arena, fleet)] if arena.copilot is not None else []
    made += [rooms.link(arena, v, fleet) for v in arena.vehicles if v.wire is not None]
    made += [rooms.px4(arena, v, fleet) for v in arena.vehicles if v.autopilot == "px4"]
    for v in arena.vehicles:
        made += [rooms.forward(arena, v)] if v.forward else []
        made += [rooms.logger(arena, v), rooms.program(arena, v)]
    for one in made:
        yield one["name"], one


def _vehicle(arena: Arena, v: Vehicle) -> VehiclePlan:
    return VehiclePlan(
        name=v.name,
        id=v.id,
        autopilot=v.autopilot,
        profile=v.profile.name,
        simulated=v.simulated,
        router=rooms.link_of(arena, v, "router"),
        vision=rooms.link_of(arena, v, "vision"),
        panic=rooms.link_of(arena, v, "panic"),
        port=v.ports.program,
        sdk_port=v.ports.sdk,
        tools_port=v.ports.tools,
        logger_port=v.ports.logger,
        mocap_body=v.mocap_body,
    )


def _processes(arena: Arena, python: str) -> Iterator[ProcessSpec]:
    """In start order: a process stands after all that it needs."""
    world = ("world",) if arena.simulated else ()
    if arena.simulated:
        yield _room(arena, python, "world", "world")
        yield _room(arena, python, "mocap", "mocap", needs=world)
    yield from _autopilots(arena, python, world)
    for v in arena.vehicles:
        if v.forward:
            yield _room(arena, python, "forward", f"forward.{v.name}", v, needs=_before_poses(v, world))
    yield _room(arena, python, "router", "router", needs=world)
    if arena.copilot is not None:
        restart = Restart(mode="on_failure" if arena.copilot.on_loss == "restart" else "never")
        seen_by = ("world", "mocap") if arena.simulated else ()
        silent_for_s = COPILOT_SILENT_S if arena.hardware else None
        room = _room(arena, python, "copilot", "copilot", needs=(*seen_by, "router"))
        yield replace(room, restart=restart, silent_for_s=silent_for_s)
    for v in arena.vehicles:
        # where no program would be lost with the copilot, its vehicle's logger stands for it
        needs = ("router",) if v.program is not None else ("router", *_watched(arena))
        yield _room(arena, python, "logger", f"logger.{v.name}", v, needs=needs)
    for v in arena.vehicles:
        if v.program is not None:
            yield _program(arena, python, v)
    yield from _tools(arena)


def _watched(arena: Arena) -> tuple[str, ...]:
    """What flies needs the copilot, and is landed without it, unless the YAML asks for a warning alone."""
    return ("copilot",) if arena.copilot is not None and arena.copilot.on_loss != "warn" else ()


def _before_poses(v: Vehicle, world: tuple[str, ...]) -> tuple[str, ...]:
    """What a forwarder needs. One whose PX4 never comes is given up with it, at once, and with it the vehicle's program."""
    if not v.simulated:
        return (f"link.{v.name}",)
    return (*world, "mocap", f"px4.{v.name}") if v.autopilot == "px4" else (*world, "mocap")


def _autopilots(arena: Arena, python: str, world: tuple[str, ...]) -> Iterator[ProcessSpec]:
    """Those that are processes of their own, and those that stand for one outside."""
    for v in arena.vehicles:
        if v.autopilot == "px4":
            yield _room(arena, python, "px4", f"px4.{v.name}", v, needs=world)
    for v in arena.vehicles:
        if v.wire is not None:
            yield _room(arena, python, "link", f"link.{v.name}", v, needs=world if v.simulated else ())


def _room(
    arena: Arena, python: str, kind: Kind, name: str, v: Vehicle | None = None, needs: tuple[str, ...] = ()
) -> ProcessSpec:
    module, cpu, memory, more = _ROOMS[kind]
    fields: dict[str, Any] = {"restart": Restart(mode="on_failure"), "nice": _first(arena, kind), **more}
    if v is not None and v.wire is not None:
        fields["start_timeout_s"] = REAL_START_TIMEOUT_S
    return ProcessSpec(
        name=name,
        kind=kind,
        vehicle=v.name if v else None,
        argv=(python, "-m", module, f"{{run}}/slices/{name}.json"),
        env=ENV,
        needs=needs,
        outlives=True,
        cpu_budget=cpu,
        memory_budget_mb=memory,
        listens=tuple(_listens(arena, kind, v)),
        **fields,
    )


def _first(arena: Arena, kind: Kind) -> int:
    """Return the nice value of a room that must not wait for other programs, 0 where nothing asks for it."""
    if kind == "world":
        return NICE_WORLD_REALTIME if arena.sim.realtime else 0
    if kind == "copilot":
        return NICE_COPILOT_FIRST if arena.sim.realtime or arena.hardware else 0
    return 0


def _listens(arena: Arena, kind: Kind, vehicle: Vehicle | None) -> Iterator[Listen]:
    """Every UDP port that a process binds for itself; receivers of multicast share theirs and are not listed."""
    found: list[tuple[int, str]] = []
    of = arena.vehicles if vehicle is None else (vehicle,)
    if kind == "link" and vehicle is not None and vehicle.wire is not None and vehicle.wire.kind == "udpin":
        what = f"the wire of {vehicle.name}"
        yield Listen(protocol="udp", address=vehicle.wire.host, port=vehicle.wire.port, what=what)
    if kind == "mocap":
        settings = vendor_settings(arena.mocap.emulates)
        used = settings.server_sockets(settings.server_settings(arena.mocap.keys, arena.address))
        found += [(socket.port, socket.what) for socket in used if socket.port]
    if kind == "router":
        found.append((LINK_BASE, "ground stations"))
    if kind == "copilot":
        found.append((COPILOT, "heartbeats of programs"))
    for v in of:
        if kind == "world" and v.autopilot != "builtin":
            if v.simulated:
                yield Listen(
                    protocol="tcp",
                    address=arena.address,
                    port=v.ports.simulator,
                    what=f"simulator API of {v.name}",
                )
            continue
        found += [(getattr(v.ports, key), f"{words} of {v.name}") for key, words in _BOUND.get(kind, ())]
    for port, words in found:
        # PX4 binds its links on every address of the computer, whatever it is told; the stand-in on the arena's.
        everywhere = kind == "px4" and arena.px4 is not None and not arena.px4.stand_in
        address = "0.0.0.0" if everywhere else arena.address
        yield Listen(protocol="udp", address=address, port=port, what=words)


_AUTOPILOT_ENDS = (
    ("router_autopilot", "router link"),
    ("vision_autopilot", "vision link"),
    ("panic_autopilot", "panic link"),
)
_BOUND: dict[str, tuple[tuple[str, str], ...]] = {
    "world": _AUTOPILOT_ENDS,
    "px4": _AUTOPILOT_ENDS,
    "link": _AUTOPILOT_ENDS,
    "forward": (("vision_forwarder", "vision link"),),
    "router": (("router_router", "router link"), ("tools", "tools"), ("serve", "programs")),
    "logger": (("logger", "log stream"),),
    "program": (("program", "MAVLink"),),
    "task": (("panic_land_all", "panic link"),),
}


def _program(arena: Arena, python: str, v: Vehicle) -> ProcessSpec:
    """The user's program: a `.py` file under our interpreter, anything else as it is."""
    program, name = v.program, f"program.{v.name}"
    if program is None:
        raise ValueError(f"{v.name} has no program")
    start = (python, program.path) if program.path.endswith(".py") else (program.path,)
    needs = (f"forward.{v.name}",) if v.forward else ("world",) if v.simulated else ()
    needs = (*needs, f"link.{v.name}") if v.wire is not None else needs
    return ProcessSpec(
        name=name,
        kind="program",
        vehicle=v.name,
        argv=(*start, "--uav", f"{{run}}/slices/{name}.json", *program.args),
        cwd=arena.folder,
        env=ENV,
        needs=(*needs, "router", *_watched(arena), f"logger.{v.name}"),
        ready="started",
        restart=Restart(mode=program.restart),
        stopped_for_s=None,
        cpu_budget=0.3,
        memory_budget_mb=300.0,
        nice=NICE_PROGRAM,
        listens=tuple(_listens(arena, "program", v)),
    )


def _tools(arena: Arena) -> Iterator[ProcessSpec]:
    for name, tool in arena.tools.items():
        yield _tool(arena, f"tool.{name}", tool, None)
    for v in arena.vehicles:
        for name, tool in v.tools.items():
            yield _tool(arena, f"tool.{v.name}.{name}", tool, v.name)


def _tool(arena: Arena, name: str, tool: Tool, vehicle: str | None) -> ProcessSpec:
    return ProcessSpec(
        name=name,
        kind="tool",
        vehicle=vehicle,
        argv=tool.argv,
        cwd=str(Path(arena.folder) / (tool.cwd or "")),
        env=(*ENV, *sorted(tool.env.items())),
        needs=("router", *_watched(arena)) if tool.needs is None else tool.needs,
        ready="started",
        restart=Restart(mode=tool.restart),
        stopped_for_s=None,
    )


def _land(arena: Arena, python: str) -> ProcessSpec:
    argv = (python, "-m", "arena.emergency.land_all", "--run", "{run}")
    return _task("land", argv, listens=tuple(_listens(arena, "task", None)))


def _task(name: str, argv: tuple[str, ...], **more: Any) -> ProcessSpec:
    return ProcessSpec(name=name, kind="task", argv=argv, env=ENV, ready="started", **more)
