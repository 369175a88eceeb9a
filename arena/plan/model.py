"""The plan: processes as data. Made by `make_plan`, printed by `arena plan`, obeyed by the supervisor.

Text in argv, env, cwd and slices may hold two placeholders that only a run can fill:
    {run}  the run folder, absolute       {rt}  the run's private folder for local sockets and shared pages
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any, Literal

Kind = Literal[
    "world", "px4", "link", "mocap", "forward", "router", "copilot", "logger", "program", "tool", "task"
]


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
    """One process, complete.

    needs: names that must be READY first.  ready: how readiness is proven: `reported` (the process sends it), `started`
    (the exec worked: programs and plain tools), `port` (something listens on ready_port).  outlives: it serves a vehicle that
    may be flying, so it survives the supervisor and ends by itself; others get a parent-death signal.
    stopped_for_s: one that is stopped (SIGSTOP) so long is killed, and its restart policy holds; None: it is only told of.
    silent_for_s: one that runs and has told nothing on its line for so long is killed in the same way; None: nobody minds.
    cpu_budget: fraction of one core; memory_budget_mb: resident [MB]; both only reported on.
    """

    name: str
    kind: Kind
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
    """One MAVLink connection between an autopilot and its fixed partner, UDP. Hosts are numeric addresses."""

    autopilot_host: str
    autopilot_port: int
    partner_host: str
    partner_port: int


@dataclass(frozen=True, kw_only=True)
class VehiclePlan:
    """What land-all, tools and the table know of a vehicle. id: MAV_SYS_ID."""

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
        """The plan as `plan.json` in the run folder; `from_json` reads it back equal."""
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
