"""The validated arena that `load_arena` returns: frozen, nothing left to a default."""

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
    """A value and its source in words: `arena.yaml:14`, `default`, `profile iris`, `--set`."""

    value: Value
    source: str


@dataclass(frozen=True, kw_only=True)
class Px4:
    """A PX4 on this machine.

    argv: start of its command line: absolute path of the binary.
    data: folder `etc` with its startup scripts.
    version: from the binary; "" when unknown.
    home: folder in which it was found; source: the setting that names the folder.
    stand_in: arena's own stand-in (`arena.autopilot.sitl_standin`), not PX4.
    """

    argv: tuple[str, ...]
    data: str
    version: str
    home: str
    source: str
    stand_in: bool = False

    @property
    def words(self) -> str:
        """Name and version for people."""
        return (
            "arena's stand-in for PX4" if self.stand_in else f"PX4 {self.version or 'of an unknown version'}"
        )


@dataclass(frozen=True, kw_only=True)
class Fence:
    """The box that the centres of the vehicles must stay in, with the margin already taken off.

    north, east: lowest and highest coordinate [m] [NED].
    up: height above the floor [m].
    """

    north: tuple[float, float]
    east: tuple[float, float]
    up: float

    def slice(self) -> dict[str, Any]:
        """Return the box as plain JSON, for slices."""
        return {"north": list(self.north), "east": list(self.east), "up": self.up}

    def farthest(self, north: float, east: float) -> float:
        """Return the horizontal distance from a place to the farthest corner [m]."""
        return max(math.dist((north, east), corner) for corner in itertools.product(self.north, self.east))


@dataclass(frozen=True, kw_only=True)
class Program:
    """A user's program. path: absolute path."""

    path: str
    args: tuple[str, ...] = ()
    restart: RestartMode = "never"


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A vehicle after the merge of all layers: nothing is left to a default.

    id: MAV_SYS_ID.
    profile: with the vehicle's own overrides; profile_key: its name, or the absolute path of its file.
    autopilot: the one that flies; asked: the one that the YAML names.
    position: north, east, down of the lowest point at the start [m] [NED].
    rpy_deg: roll, pitch, yaw at the start [deg].
    gcs: further addresses of ground stations.
    own_params: PX4 parameters that the user names; `arena.plan.firmware` makes the complete set.
    overrides: mass and sensor noise that replace the profile's.
    wind_m_s: wind at this vehicle [m/s] [NED]; None for that of the world.
    forward: whether a pose forwarder feeds the autopilot, pose_rate_hz times per second.
    wire: connection to a real flight controller; None when the autopilot runs on this computer.
    px4_version: version of the PX4 that flies, or that the YAML names; "" when unknown.
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
        """True when the vehicle's body is in the simulated world, whatever autopilot flies it."""
        return self.autopilot != "hardware"


@dataclass(frozen=True, kw_only=True)
class Arena:
    """A validated arena: intent only, without PX4 parameters and processes.

    file: path of the YAML as the user named it; folder: its absolute folder.
    address: numeric address that everything local binds.
    px4: the PX4 that flies; None when no vehicle flies one.
    geofence: None without a geofence.
    source: the YAML with the places of its values, for problems found later.
    origins: dotted key -> value and its source, for `arena plan --explain`.
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
        """Return a vehicle by its name. Raises KeyError."""
        return {v.name: v for v in self.vehicles}[name]

    @property
    def simulated(self) -> tuple[Vehicle, ...]:
        """Vehicles with a body in the simulated world, in the order of its rows."""
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
