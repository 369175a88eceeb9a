"""The plan: processes as data. Made by `make_plan`, printed by `arena plan`, obeyed by the supervisor.

Text in argv, env, cwd and slices may hold two placeholders that only a run can fill:
    {run}  the run folder, absolute       {rt}  the run's private folder for local sockets and shared pages
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any, Literal


@dataclass(frozen=True, kw_only=True)
class Restart:
    """mode: whether an exit is followed by a new start. limit: starts within window_s [s] before it is FATAL.

    backoff_s: the first wait [s]; doubled at each further one.
    """

    mode: Literal["never", "on_failure", "always"] = "never"
    limit: int = 5
    window_s: float = 30.0
    backoff_s: float = 0.25


@dataclass(frozen=True, kw_only=True)
class Listen:
    """A socket that this process will have open. protocol: udp or tcp; what: the words for a person."""

    protocol: Literal["udp", "tcp"]
    address: str
    port: int
    what: str


@dataclass(frozen=True, kw_only=True)
class ProcessSpec:
    """A process with everything that its start, supervision and stop need.

    needs: names of the processes that must be READY first.
    ready: proof of readiness: `reported` (the process sends it), `started` (the exec succeeded: programs and tools),
        `port` (something listens on ready_port).
    start_timeout_s, stop_timeout_s: limits for becoming READY, and for ending after the stop signal [s].
    stopped_for_s: kill a process that is stopped (SIGSTOP) for this time [s]; None only reports it.
    silent_for_s: kill a process that has reported nothing for this time [s]; None for no limit.
    restart: holds after such a kill too.
    outlives: the process serves a vehicle that may be flying: it survives the supervisor and ends by itself. Others get
        a parent-death signal.
    nice: added to the caller's priority.
    cpu_budget, memory_budget_mb: [cores], resident [MB]; a process above them is reported.
    listens: UDP and TCP ports that the process binds.
    """

    name: str
    kind: str
    vehicle: str | None = None
    argv: tuple[str, ...]
    cwd: str = "{run}"
    env: tuple[tuple[str, str], ...] = ()
    needs: tuple[str, ...] = ()
    ready: Literal["reported", "started", "port"] = "reported"
    ready_port: int = 0
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


@dataclass(frozen=True, kw_only=True)
class LinkPlan:
    """A UDP MAVLink connection between an autopilot and its fixed partner. Hosts are numeric addresses."""

    autopilot_host: str
    autopilot_port: int
    partner_host: str
    partner_port: int


@dataclass(frozen=True, kw_only=True)
class VehiclePlan:
    """The names and addresses of a vehicle, for land-all, tools and the live table. id: MAV_SYS_ID."""

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
    logger_port: int
    mocap_body: str


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything a run does.

    slices: file name under the run's `slices/` -> the JSON object that a room reads.  land: the task that the supervisor runs
    before it stops anything while a vehicle may be flying.  report: the task it runs when all has stopped.
    yaml: the resolved arena, as text, for the run folder.
    """

    name: str
    address: str
    vehicles: tuple[VehiclePlan, ...]
    processes: tuple[ProcessSpec, ...]
    slices: dict[str, dict[str, Any]] = field(default_factory=dict)
    land: ProcessSpec | None = None
    report: ProcessSpec | None = None
    yaml: str = ""

    def to_json(self) -> str:
        """Return the text of `plan.json`, which `from_json` reads back equal."""
        return json.dumps(dataclasses.asdict(self), indent=1)

    @classmethod
    def from_json(cls, text: str) -> Plan:
        raw = json.loads(text)
        vehicles = tuple(
            VehiclePlan(**{**v, **{link: LinkPlan(**v[link]) for link in ("router", "vision", "panic")}})
            for v in raw.pop("vehicles")
        )
        processes = tuple(_process(p) for p in raw.pop("processes"))
        land, report = (
            _process(raw.pop(key)) if raw.get(key) else raw.pop(key) for key in ("land", "report")
        )
        return cls(vehicles=vehicles, processes=processes, land=land, report=report, **raw)


def _process(raw: dict[str, Any]) -> ProcessSpec:
    return ProcessSpec(
        **{
            **raw,
            "argv": tuple(raw["argv"]),
            "env": tuple((k, v) for k, v in raw["env"]),
            "needs": tuple(raw["needs"]),
            "restart": Restart(**raw["restart"]),
            "listens": tuple(Listen(**x) for x in raw["listens"]),
        }
    )
