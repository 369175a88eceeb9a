"""The resolved arena: what `load_arena` returns. Frozen, explicit, nothing left to default."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from arena.schema.copilot import Copilot
from arena.schema.mocap import Mocap
from arena.schema.models import Failsafe, Preflight, RestartMode, Sim, Tool, World
from arena.schema.ports import COPILOT, GROUND_STATION, LINK_BASE, Port, VehiclePorts
from arena.schema.profile import Profile
from arena.schema.source import Source
from arena.transport import ConnectionUrl

Value = object
Autopilot = Literal["builtin", "px4", "hardware", "hitl"]


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where a value came from, in words: `arena.yaml:14`, `default`, `profile iris`, `--set`."""

    value: Value
    source: str


@dataclass(frozen=True, kw_only=True)
class Px4:
    """A PX4 on this machine. argv: how its command line begins, the binary's absolute path; data: the folder `etc` of its
    startup scripts; version: as the binary says, "" when it does not; home: what was looked at; source: who named it.

    stand_in: it is arena's own, see `arena.autopilot.sitl_standin`, and no PX4.
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
        return (
            "arena's stand-in for PX4" if self.stand_in else f"PX4 {self.version or 'of an unknown version'}"
        )


@dataclass(frozen=True, kw_only=True)
class Fence:
    """The box that the vehicles' centres must stay in, margin taken off: along north and east (lowest, highest), and its ceiling
    above the floor [m].
    """

    north: tuple[float, float]
    east: tuple[float, float]
    up: float

    def slice(self) -> dict[str, Any]:
        """As rooms are told."""
        return {"north": list(self.north), "east": list(self.east), "up": self.up}

    def farthest(self, north: float, east: float) -> float:
        """From a place to the farthest of its corners, along the floor [m]."""
        return max(math.dist((north, east), corner) for corner in itertools.product(self.north, self.east))


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
    rpy_deg: roll, pitch, yaw [deg].  params: PX4 name -> value, all that differ from PX4's own defaults; of hardware, those
    that must hold before it arms.  needs: the same in words, for any version of PX4.  px4_version: whose names
    the parameters have.  cannot: what the YAML asks of its parameters and its PX4 has none for, a sentence each.
    wire: how a real autopilot is reached, None when it runs here.
    """

    name: str
    id: int
    profile: Profile
    profile_key: str
    autopilot: Autopilot
    asked: str
    position: tuple[float, float, float]
    rpy_deg: tuple[float, float, float]
    ports: VehiclePorts
    gcs: tuple[str, ...]
    own_params: Mapping[str, float]
    overrides: Mapping[str, Any] = field(default_factory=dict)
    wind_m_s: tuple[float, float, float] | None = None
    mocap_body: str
    forward: bool
    pose_rate_hz: float
    program: Program | None
    neighbours: tuple[str, ...]
    tools: Mapping[str, Tool]
    wire: ConnectionUrl | None = None
    gps: bool = False
    sticks: bool = False
    px4_version: str = ""

    def port_address(self, port: Port, address: str) -> tuple[str, int] | None:
        """Return host and number of one of the vehicle's ports. address: of the arena."""
        if port.key != "wire":
            return address, getattr(self.ports, port.key)
        wire = self.wire
        return (wire.host, wire.port) if wire is not None and wire.kind == "udpin" else None

    @property
    def simulated(self) -> bool:
        """Its body is in the world here, whatever flies it."""
        return self.autopilot != "hardware"


@dataclass(frozen=True, kw_only=True)
class Arena:
    """One arena. file: as the user named it.  folder: absolute, of that file.
    px4: the one that its vehicles fly, None when none does.  geofence: None where the YAML draws none.

    origins: dotted key -> its value and where that came from, for `arena plan --explain`.
    """

    name: str
    file: str
    folder: str
    address: str
    world: World
    sim: Sim
    mocap: Mocap
    preflight: Preflight
    tools: Mapping[str, Tool]
    vehicles: tuple[Vehicle, ...]
    px4: Px4 | None = None
    copilot: Copilot | None = None
    geofence: Fence | None = None
    failsafe: Failsafe
    landing_speed_m_s: float | None = None
    source: Source = field(compare=False, repr=False)
    origins: Mapping[str, Origin] = field(default_factory=dict, repr=False)

    def vehicle(self, name: str) -> Vehicle:
        """Raises KeyError."""
        return {v.name: v for v in self.vehicles}[name]

    @property
    def simulated(self) -> tuple[Vehicle, ...]:
        """Those with a body in the world, in the order of its rows."""
        return tuple(v for v in self.vehicles if v.simulated)

    @property
    def hardware(self) -> tuple[Vehicle, ...]:
        return tuple(v for v in self.vehicles if not v.simulated)

    def port_address(self, port: Port, vehicle: Vehicle | None = None) -> tuple[str, int] | None:
        """Return host and number of a row of the port table, or None where there is no such port.

        vehicle: the vehicle of a port that each vehicle has.
        """
        if port.per_vehicle:
            return None if vehicle is None else vehicle.port_address(port, self.address)
        numbers = {
            "ground_stations": LINK_BASE,
            "copilot": COPILOT if self.copilot is not None else None,
            "ground_station": GROUND_STATION,
        }
        number = numbers[port.key]
        return None if number is None else (self.address, number)
