"""Data classes of the plan: the processes of a run, and their settings.

`make_plan` creates a plan, and the supervisor runs it.

Text in argv, env, cwd and slices may hold placeholders that only a run can fill:
    {run}  the run folder, absolute       {rt}  the runtime folder, for local sockets and shared pages
    {brace}  the character {, before a text that would otherwise be a placeholder
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any, Literal

from arena.simulation_speed import slowdown

PROGRAMS = ("program", "group")
"""Kinds of processes that run user programs."""


@dataclass(frozen=True, kw_only=True)
class Restart:
    """Restart policy of a process: when and how often the supervisor restarts it after its exit.

    mode: when an exit is followed by a restart.
    limit: number of starts within window_s [s] after which the process becomes FATAL.
    backoff_s: wait before the first restart [s]; it doubles with each further restart.
    """

    mode: Literal["never", "on_failure", "always"] = "never"
    limit: int = 5
    window_s: float = 30.0
    backoff_s: float = 0.25


@dataclass(frozen=True, kw_only=True)
class Listen:
    """A port that a process binds.

    protocol: udp or tcp. what: purpose of the port, as shown to the user.
    """

    protocol: Literal["udp", "tcp"]
    address: str
    port: int
    what: str


@dataclass(frozen=True, kw_only=True)
class Member:
    """Part of the arena that runs inside another process, such as a program in the process of its group.

    It runs inside the process `world` (fused arena), or is a user program
    in the process of a group. name, kind, vehicle: as in `ProcessSpec`.
    """

    name: str
    kind: str
    vehicle: str | None = None


@dataclass(frozen=True, kw_only=True)
class ProcessSpec:
    """Description of a process: everything that the supervisor needs to start, monitor and stop it.

    needs: names of the processes that must be READY first.
    ready: condition for READY: `reported` (the process sends READY), `started` (exec succeeded; for programs and tools),
        `port` (the process serves ready_port), `log` (a line of its log matches the regular expression ready_value),
        `file` (the file ready_value exists), `delay` (ready_value seconds have passed since the start).
    start_timeout_s: longest time from start to READY [s].
    stop_timeout_s: longest time from the stop signal to the exit [s].
    stopped_for_s: kill the process if it is paused by SIGSTOP for this time [s]; None: only report it.
    silent_for_s: kill the process if it reports nothing for this time [s]; None: no limit.
    restart: restart policy; also used after such a kill.
    outlives: true if the process serves a vehicle that may be flying. It then continues when the supervisor dies, and ends
        by itself. All other processes get a parent-death signal.
    nice: added to the supervisor's own nice value.
    cpu_budget: expected CPU [cores]; the supervisor reports a process that uses more.
    memory_budget_mb: expected resident memory [MB]; the supervisor reports a process that uses more.
    listens: UDP and TCP ports that the process binds.
    members: parts of the arena, or programs of a group, that run in this process; empty if it is only itself.
    """

    name: str
    kind: str
    vehicle: str | None = None
    argv: tuple[str, ...]
    cwd: str = "{run}"
    env: tuple[tuple[str, str], ...] = ()
    needs: tuple[str, ...] = ()
    ready: Literal["reported", "started", "port", "log", "file", "delay"] = "reported"
    ready_port: int = 0
    ready_value: str = ""
    start_timeout_s: float = 30.0
    stop_signal: Literal["SIGTERM", "SIGINT"] = "SIGTERM"
    stop_timeout_s: float = 5.0
    stopped_for_s: float | None = 1.0
    silent_for_s: float | None = None
    restart: Restart = Restart()
    outlives: bool = False
    nice: int = 0
    cpu_budget: float = 0.5
    memory_budget_mb: float = 200.0
    listens: tuple[Listen, ...] = ()
    members: tuple[Member, ...] = ()

    @property
    def is_program(self) -> bool:
        """True for the process of a user program, or of a group of user programs."""
        return self.kind in PROGRAMS

    @property
    def flies(self) -> tuple[str, ...]:
        """Return the vehicles that the user programs in this process fly; () if the process runs no user program."""
        if not self.is_program:
            return ()
        own = (self.vehicle, *(m.vehicle for m in self.members))
        return tuple(name for name in own if name is not None)


@dataclass(frozen=True, kw_only=True)
class LinkPlan:
    """The two addresses of a MAVLink link over UDP: that of the autopilot and that of its partner.

    The partner is the router, the pose forwarder or land-all. Hosts are numeric addresses.
    """

    autopilot_host: str
    autopilot_port: int
    partner_host: str
    partner_port: int


@dataclass(frozen=True, kw_only=True)
class VehiclePlan:
    """Names and addresses of one vehicle, as land-all, tools and the table of `arena up` need them.

    id: MAVLink system id (MAV_SYS_ID). radio: `required` if a pilot has an RC transmitter.
    axes_check: `required` if a real vehicle must pass `arena preflight` before it can arm, `none` if not; "" for vehicles
        without this check.
    """

    name: str
    id: int
    autopilot: str
    profile: str
    simulated: bool
    router: LinkPlan
    vision: LinkPlan
    panic: LinkPlan
    port: int
    sdk_port: int
    tools_port: int
    mocap_body: str
    radio: str = "none"
    axes_check: str = ""


_REMOVED_KEYS = frozenset({"logger_port"})


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Plan of one run, for the supervisor: all processes, their configuration files, and the tasks at the end.

    slices: file name in the run's folder `slices/` -> configuration of one process, as a JSON object.
    land: task that lands all vehicles; the supervisor runs it before it stops processes while a vehicle may be flying.
    report: task that the supervisor runs after all processes have stopped.
    yaml: text of the resolved arena.yaml, for the run folder.
    replay: path of the recorded flight that is played back, "" for a flight. A replay has no vehicle: nothing can fly or land.
    """

    name: str
    address: str
    vehicles: tuple[VehiclePlan, ...]
    processes: tuple[ProcessSpec, ...]
    slices: dict[str, dict[str, Any]] = field(default_factory=dict)
    land: ProcessSpec | None = None
    report: ProcessSpec | None = None
    yaml: str = ""
    replay: str = ""

    @property
    def slowdown(self) -> float:
        """Factor by which waits for simulated vehicles take longer in wall time [-]: 2 at `--speed 0.5`, 1 in real time or faster."""
        return slowdown(self.slices.get("world.json", {}).get("speed", 1.0))

    @property
    def is_replay(self) -> bool:
        """True if this is the plan of a replay. A plan with a real vehicle is never a replay."""
        return bool(self.replay) and all(v.simulated for v in self.vehicles)

    def to_json(self) -> str:
        """Return the plan as JSON, the content of `plan.json`.

        `from_json` converts this text to an equal plan.
        """
        return json.dumps(dataclasses.asdict(self), indent=1)

    @classmethod
    def from_json(cls, text: str) -> Plan:
        raw = json.loads(text)
        vehicles = tuple(
            VehiclePlan(**{**v, **{link: LinkPlan(**v[link]) for link in ("router", "vision", "panic")}})
            for v in map(_without_removed_keys, raw.pop("vehicles"))
        )
        processes = tuple(_process(p) for p in raw.pop("processes"))
        land, report = (
            _process(raw.pop(key)) if raw.get(key) else raw.pop(key) for key in ("land", "report")
        )
        return cls(vehicles=vehicles, processes=processes, land=land, report=report, **raw)


def _without_removed_keys(vehicle: dict[str, Any]) -> dict[str, Any]:
    """Return a vehicle of an old plan.json without the keys that arena no longer has."""
    return {key: value for key, value in vehicle.items() if key not in _REMOVED_KEYS}


def _process(raw: dict[str, Any]) -> ProcessSpec:
    return ProcessSpec(
        **{
            **raw,
            "argv": tuple(raw["argv"]),
            "env": tuple((k, v) for k, v in raw["env"]),
            "needs": tuple(raw["needs"]),
            "restart": Restart(**raw["restart"]),
            "listens": tuple(Listen(**x) for x in raw["listens"]),
            "members": tuple(Member(**x) for x in raw.get("members", ())),
        }
    )
