"""The resolved arena: what `load_arena` returns. Frozen, explicit, nothing left to default."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from arena.schema.models import Mocap, RestartMode, Sim, Tool, World
from arena.schema.ports import VehiclePorts
from arena.schema.profile import Profile

Value = object


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where a value came from, in words: `arena.yaml:14`, `default`, `profile iris`, `--set`."""

    value: Value
    source: str


@dataclass(frozen=True, kw_only=True)
class Px4:
    """A PX4 on this machine. argv: how its command line begins, the binary's absolute path; data: the folder `etc` of its
    startup scripts; version: as the binary says, "" when it does not; home: what was looked at; source: who named it.

    stand_in: it is arena's own, see `arena.autopilot.standin`, and no PX4.
    """

    argv: tuple[str, ...]
    data: str
    version: str
    home: str
    source: str
    stand_in: bool = False

    @property
    def words(self) -> str:
        """What it is, for people."""
        return "arena's stand-in for PX4" if self.stand_in else f"PX4 {self.version or 'of an unknown version'}"


@dataclass(frozen=True, kw_only=True)
class Program:
    """A user's program. path: absolute."""

    path: str
    args: tuple[str, ...] = ()
    restart: RestartMode = "never"


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """One vehicle, everything decided.

    profile_key: how the profile is found, a name or an absolute path.
    autopilot: what will fly it; asked: what the YAML said.  position: N, E, D of its lowest point [m] [NED].
    rpy_deg: roll, pitch, yaw [deg].  params: PX4 name -> value, all that differ from PX4's own defaults.
    """

    name: str
    id: int
    profile: Profile
    profile_key: str
    autopilot: Literal["builtin", "px4"]
    asked: str
    position: tuple[float, float, float]
    rpy_deg: tuple[float, float, float]
    ports: VehiclePorts
    gcs: tuple[str, ...]
    params: Mapping[str, float]
    mocap_body: str
    forward: bool
    pose_rate_hz: float
    program: Program | None
    neighbours: tuple[str, ...]
    tools: Mapping[str, Tool]


@dataclass(frozen=True, kw_only=True)
class Arena:
    """One arena. file: as the user named it.  folder: absolute, of that file.  group: multicast group of the capture.
    px4: the one that its vehicles fly, None when none does.

    origins: dotted key -> its value and where that came from, for `arena plan --explain`.
    """

    name: str
    file: str
    folder: str
    address: str
    world: World
    sim: Sim
    mocap: Mocap
    group: str
    tools: Mapping[str, Tool]
    vehicles: tuple[Vehicle, ...]
    px4: Px4 | None = None
    origins: Mapping[str, Origin] = field(default_factory=dict, repr=False)

    def vehicle(self, name: str) -> Vehicle:
        """Raises KeyError."""
        return {v.name: v for v in self.vehicles}[name]

    @property
    def process_names(self) -> list[str]:
        """Names of the processes that its plan will have, in start order."""
        names = process_names(
            [(v.name, v.forward, v.program is not None, list(v.tools)) for v in self.vehicles],
            list(self.tools),
        )
        return [*names[:2], *(f"px4.{v.name}" for v in self.vehicles if v.autopilot == "px4"), *names[2:]]


def process_names(vehicles: list[tuple[str, bool, bool, list[str]]], tools: list[str]) -> list[str]:
    """vehicles: (name, has a forwarder, has a program, names of its tools)."""
    names = ["world", "mocap"]
    names += [f"forward.{v}" for v, forward, _, _ in vehicles if forward]
    names += ["router"] + [f"logger.{v}" for v, *_ in vehicles]
    names += [f"program.{v}" for v, _, program, _ in vehicles if program]
    names += [f"tool.{t}" for t in tools]
    return names + [f"tool.{v}.{t}" for v, _, _, own in vehicles for t in own]
