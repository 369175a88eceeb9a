"""The process table: one row per kind of process, in start order. Pure.

To add a kind of process: write a package with a `__main__`, a function in `arena.plan.slices` that makes its configuration,
one row here, and a row in `arena.schema.ports` for each port that it binds. The plan, `arena plan`, the checks and
docs/reference/processes.md are made from the rows. A process stops before the processes that it needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from arena.constants import PROCESS_ENV
from arena.mocap.vendors import vendor_settings
from arena.plan import slices
from arena.plan.copilot_slice import copilot
from arena.plan.job import Job, Json, flies_px4_sitl, program_args
from arena.plan.model import Listen, Member, ProcessSpec, Restart
from arena.plan.program_slice import group, program, program_restart
from arena.plan.sensors_slice import sensors
from arena.schema import Arena, Vehicle
from arena.schema.placeholders import variables
from arena.schema.ports import PORTS
from arena.simulation_speed import slowdown

NICE_PROGRAM, NICE_RECORDER = 2, 1
NICE_WORLD_REALTIME, NICE_COPILOT_FIRST = -10, -5

REAL_START_TIMEOUT_S = 600.0
"""Start time limit for processes of hardware, because hardware may be switched on long after the arena [s]."""
COPILOT_SILENT_S = 5.0
"""Kill the copilot of hardware if it reports nothing for this time [s]. Not used in simulation, where time may stand still."""

SILENT_S = 6.0
"""Kill and restart a router, forwarder or link that reports nothing for this time [s].

They report once per second of wall time, also in a simulation that stands still. On a machine five times slower a report
may come every 5 s. A process that only waits for data still reports, so a longer silence means that it hangs.
"""


@dataclass(frozen=True, kw_only=True)
class ProcessKind:
    """A kind of process, such as `router` or `world`, with the functions that make its `ProcessSpec`.

    kind: name of the process, or with `per_vehicle` the first part of `kind.VEHICLE`.
    module: package that `python -m` runs with the path of the slice; "" if the user gives the command.
    purpose: what the process does, for the reference page.
    per_vehicle: whether each vehicle can have such a process; false: the arena has at most one.
    per_group: whether each group of vehicles, whose programs share one process, has such a process.
    exists: function that returns whether this arena, or this vehicle, has such a process.
    needs: function that returns the names of processes that must be ready first.
    slice: function that makes the process's JSON configuration (slice); None if the process has no slice.
    cpu_budget, memory_budget_mb: expected CPU [cores] and memory [MB]; the supervisor reports a process that uses more.
    fields: other fields of `ProcessSpec`: readiness, restart policy, time limits, priority.
    configured: function that returns further fields, which depend on the arena.
    command: function that returns the command line; None for `python -m MODULE SLICE`.
    """

    kind: str
    module: str = ""
    purpose: str
    per_vehicle: bool = False
    per_group: bool = False
    exists: Callable[[Job], bool] = lambda job: True
    needs: Callable[[Job], tuple[str, ...]]
    slice: Callable[[Job], Json] | None = None
    cpu_budget: float
    memory_budget_mb: float
    fields: Mapping[str, Any] = field(default_factory=dict)
    configured: Callable[[Job], Mapping[str, Any]] = lambda job: {}
    command: Callable[[Job, str], tuple[str, ...]] | None = None

    def name(self, job: Job) -> str:
        """Return the name of the process for this job, such as `forward.uav1`."""
        owner = job.group or (job.vehicle.name if job.vehicle is not None else "")
        return f"{self.kind}.{owner}" if owner else self.kind


def _world_if_simulated(job: Job) -> tuple[str, ...]:
    return ("world",) if job.arena.simulated else ()


def _forwarder_needs(job: Job) -> tuple[str, ...]:
    """Return the names of the processes that must be ready before a pose forwarder starts.

    A forwarder needs its PX4, so that forwarder and program are not started if PX4 fails to start.
    """
    if not job.v.simulated:
        return (f"link.{job.v.name}",)
    cameras = ("world", "mocap")
    return (*cameras, f"px4.{job.v.name}") if job.v.autopilot == "px4" else cameras


def _copilot_needs(job: Job) -> tuple[str, ...]:
    return ("world", "mocap", "router") if job.arena.simulated else ("router",)


def _copilot_fields(job: Job) -> dict[str, Any]:
    section = job.arena.copilot
    restart = section is not None and section.on_loss == "restart"
    return {
        "restart": Restart(mode="on_failure" if restart else "never"),
        "nice": NICE_COPILOT_FIRST if job.arena.sim.realtime or job.arena.hardware else 0,
        "silent_for_s": COPILOT_SILENT_S if job.arena.hardware else None,
    }


def required_copilot(arena: Arena) -> tuple[str, ...]:
    """Return ("copilot",) if the YAML forbids flights without the copilot, else ().

    With `on_loss: warn` vehicles may fly without the copilot.
    """
    return ("copilot",) if arena.copilot is not None and arena.copilot.on_loss != "warn" else ()


def _recorder_needs(job: Job) -> tuple[str, ...]:
    """Return the names of the processes that must be ready before the recorder starts.

    In an arena without programs the recorder needs the copilot, so that the loss of the copilot ends the run. Else the
    programs need the copilot.
    """
    programs = any(v.program is not None for v in job.arena.vehicles)
    return (*_world_if_simulated(job), *(() if programs else required_copilot(job.arena)))


def _program_needs(job: Job) -> tuple[str, ...]:
    return _needs_of_program(job, job.v)


def _group_needs(job: Job) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for v in job.vehicles for name in _needs_of_program(job, v)))


def _needs_of_program(job: Job, v: Vehicle) -> tuple[str, ...]:
    poses = (f"forward.{v.name}",) if v.forward else ("world",) if v.simulated else ()
    link = (f"link.{v.name}",) if v.wire is not None else ()
    measured = ("sensors",) if v.has_sensors else ()
    tools = v.program.needs if v.program is not None else ()
    return (*poses, *link, "router", *measured, *required_copilot(job.arena), "recorder", *tools)


def _program_command(job: Job, name: str) -> tuple[str, ...]:
    """Return the command line of a user program.

    A `.py` file runs in arena's Python interpreter, and any other file as an executable.

    A `.py` file also gets `--uav FILE`. An executable gets only the arguments of the YAML, because it may refuse other options.
    """
    program = job.v.program
    if program is None:
        raise ValueError(f"cannot make the command line of a program: {job.v.name} has no program")
    args = program_args(job.arena, job.v)
    if program.is_python:
        return (job.python, program.path, "--uav", f"{{run}}/slices/{name}.json", *args)
    return (program.path, *args)


def _program_fields(job: Job) -> dict[str, Any]:
    return {
        "cwd": job.arena.folder,
        "env": (*PROCESS_ENV, *variables(job.arena, job.v)),
        "restart": program_restart(job.v),
    }


def _group_fields(job: Job) -> dict[str, Any]:
    size = len(job.vehicles)
    return {
        "cwd": job.arena.folder,
        "restart": program_restart(job.vehicles[0]),
        "cpu_budget": 1.0,
        "memory_budget_mb": 300.0 + 5.0 * size,
        "members": tuple(
            Member(name=f"program.{v.name}", kind="program", vehicle=v.name) for v in job.vehicles
        ),
    }


# Nice values are added to the supervisor's own. Programs and the recorder have a lower priority than the processes that carry
# simulated time, poses and messages; this matters when many processes start at once on few cores. A priority above the
# supervisor's is used only for the world with `sim.realtime`, and for the copilot with `sim.realtime` or hardware.
# If the system refuses the higher priority, the process keeps the supervisor's.
TABLE: tuple[ProcessKind, ...] = (
    ProcessKind(
        kind="world",
        module="arena.sim",
        purpose="pybullet world, sensors and built-in autopilots; keeps the simulation clock",
        exists=lambda job: bool(job.arena.simulated),
        needs=lambda job: (),
        slice=slices.world,
        cpu_budget=0.8,
        memory_budget_mb=400.0,
        fields={"restart": Restart(), "start_timeout_s": 60.0},
        configured=lambda job: {"nice": NICE_WORLD_REALTIME if job.arena.sim.realtime else 0},
    ),
    ProcessKind(
        kind="mocap",
        module="arena.mocap.emulator",
        purpose="motion capture emulator: NatNet frames of the simulated vehicles",
        exists=lambda job: bool(job.arena.simulated),
        needs=lambda job: ("world",),
        slice=slices.mocap,
        cpu_budget=0.3,
        memory_budget_mb=150.0,
    ),
    ProcessKind(
        kind="px4",
        module="arena.px4",
        purpose="starts a PX4 SITL and ends it with the world",
        per_vehicle=True,
        exists=lambda job: job.v.autopilot == "px4",
        needs=_world_if_simulated,
        slice=slices.px4,
        cpu_budget=0.3,
        memory_budget_mb=150.0,
        # never killed while paused by SIGSTOP: PX4 still flies, and would end with this process
        fields={"restart": Restart(), "start_timeout_s": 60.0, "stopped_for_s": None},
    ),
    ProcessKind(
        kind="link",
        module="arena.fcu_link",
        purpose="owns the UDP or serial connection to a real flight controller; preflight checks",
        per_vehicle=True,
        exists=lambda job: job.v.wire is not None,
        needs=lambda job: ("world",) if job.v.simulated else (),
        slice=slices.link,
        cpu_budget=0.2,
        memory_budget_mb=120.0,
        fields={"silent_for_s": SILENT_S},
    ),
    ProcessKind(
        kind="forward",
        module="arena.pose_forwarder",
        purpose="pose forwarder: motion capture poses to the autopilot as ODOMETRY",
        per_vehicle=True,
        exists=lambda job: job.v.forward,
        needs=_forwarder_needs,
        slice=slices.forward,
        cpu_budget=0.1,
        memory_budget_mb=120.0,
        fields={"silent_for_s": SILENT_S},
    ),
    ProcessKind(
        kind="router",
        module="arena.mavlink_router",
        purpose="MAVLink router between autopilots, programs, SDKs, ground stations and the recorder",
        needs=_world_if_simulated,
        slice=slices.router,
        cpu_budget=0.4,
        memory_budget_mb=120.0,
        fields={"silent_for_s": SILENT_S},
    ),
    ProcessKind(
        kind="sensors",
        module="arena.emulated_sensors",
        purpose="emulated relative sensors: neighbours and beacons, from motion capture or telemetry",
        exists=lambda job: any(v.has_sensors for v in job.arena.vehicles),
        needs=lambda job: (*(("world", "mocap") if job.arena.simulated else ()), "router"),
        slice=sensors,
        cpu_budget=0.3,
        memory_budget_mb=150.0,
        fields={"silent_for_s": SILENT_S, "outlives": False},
    ),
    ProcessKind(
        kind="copilot",
        module="arena.copilot",
        purpose="watches all vehicles with the motion capture; commands hold, land or terminate",
        exists=lambda job: job.arena.copilot is not None,
        needs=_copilot_needs,
        slice=copilot,
        cpu_budget=0.4,
        memory_budget_mb=150.0,
        configured=_copilot_fields,
    ),
    ProcessKind(
        kind="recorder",
        module="arena.recorder",
        purpose="writes flight.mcap, the record of the flight",
        needs=_recorder_needs,
        slice=slices.recorder,
        cpu_budget=0.3,
        memory_budget_mb=250.0,
        fields={"nice": NICE_RECORDER, "stop_timeout_s": 10.0},
    ),
    ProcessKind(
        kind="program",
        purpose="the user's program of a vehicle",
        per_vehicle=True,
        exists=lambda job: job.v.program is not None and not job.v.program.group,
        needs=_program_needs,
        slice=program,
        cpu_budget=0.3,
        memory_budget_mb=300.0,
        fields={"ready": "started", "stopped_for_s": None, "nice": NICE_PROGRAM, "outlives": False},
        configured=_program_fields,
        command=_program_command,
    ),
    ProcessKind(
        kind="group",
        module="arena.uav.group",
        purpose="the user's programs of a group of vehicles, in one process",
        per_group=True,
        needs=_group_needs,
        slice=group,
        cpu_budget=1.0,
        memory_budget_mb=300.0,
        fields={"ready": "started", "stopped_for_s": None, "nice": NICE_PROGRAM, "outlives": False},
        configured=_group_fields,
    ),
)


def jobs(row: ProcessKind, job: Job) -> Iterator[Job]:
    """Yield the planning input (`Job`) of each process of this kind in the arena.

    A `Job` contains all that is needed to describe one process.
    """
    arena = job.arena
    if row.per_group:
        for group in arena.groups:
            yield replace(job, group=group)
        return
    candidates = arena.vehicles if row.per_vehicle else (None,)
    for vehicle in candidates:
        made = replace(job, vehicle=vehicle)
        if row.exists(made):
            yield made


def process_spec(row: ProcessKind, job: Job) -> ProcessSpec:
    """Return the `ProcessSpec` of one process, from its row in the process table."""
    vehicle, name = job.vehicle, row.name(job)
    argv = (job.python, "-m", row.module, f"{{run}}/slices/{name}.json")
    fields: dict[str, Any] = {"restart": Restart(mode="on_failure"), "outlives": True}
    if vehicle is not None and vehicle.wire is not None and row.module:
        fields["start_timeout_s"] = REAL_START_TIMEOUT_S
    spec = ProcessSpec(
        name=name,
        kind=row.kind,
        vehicle=vehicle.name if vehicle else None,
        argv=row.command(job, name) if row.command else argv,
        needs=row.needs(job),
        listens=tuple(_group_listens(job) if job.group else listens(job.arena, row.kind, vehicle)),
        **{
            "env": PROCESS_ENV,
            "cpu_budget": row.cpu_budget,
            "memory_budget_mb": row.memory_budget_mb,
            **fields,
            **row.fields,
            **row.configured(job),
        },
    )
    # A process may wait for simulated vehicles, for example until an estimate is valid.
    slow = slowdown(job.arena.sim.speed) if job.arena.simulated else 1.0
    return replace(spec, start_timeout_s=slow * spec.start_timeout_s)


def _group_listens(job: Job) -> Iterator[Listen]:
    """Yield the UDP ports that the process of a group binds for MAVLink, one per vehicle."""
    for v in job.vehicles:
        yield from listens(job.arena, "program", v)


def listens(arena: Arena, kind: str, vehicle: Vehicle | None) -> Iterator[Listen]:
    """Yield the ports that must be free when a process starts.

    Multicast ports that several receivers share are not included.

    vehicle: vehicle of the process; None for a process of the whole arena, which binds ports for every vehicle.
    """
    vehicles = arena.vehicles if vehicle is None else (vehicle,)
    if kind == "mocap":
        settings = vendor_settings(arena.mocap.emulates)
        for used in settings.server_sockets(settings.server_settings(arena.mocap.keys, arena.address)):
            if used.port:
                yield Listen(protocol=used.protocol, address=arena.address, port=used.port, what=used.what)
    for port in PORTS:
        binder = port.binder(kind)
        for v in vehicles if port.per_vehicle else (None,):
            place = arena.port_address(port, v) if binder is not None else None
            if place is None or binder is None:
                continue
            if v is not None and binder.autopilots and v.autopilot not in binder.autopilots:
                continue
            # PX4 binds its links on every address of the computer; the PX4 stand-in binds the arena's address
            everywhere = kind == "px4" and v is not None and flies_px4_sitl(arena, v)
            host, number = place
            words = port.name if v is None else f"{port.name} of {v.name}"
            address = "0.0.0.0" if everywhere else host
            yield Listen(protocol=port.protocol, address=address, port=number, what=words)
