"""The validated arena that `load_arena` returns, as frozen dataclasses without missing values."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from arena.obstacles import Obstacle
from arena.schema.copilot import Copilot
from arena.schema.failsafe import Failsafe
from arena.schema.log_keys import LogKeys
from arena.schema.measured import Measured
from arena.schema.mocap import Mocap
from arena.schema.models import Preflight, Radio, Sim, World
from arena.schema.ports import COPILOT, GROUND_STATION, LINK_BASE, RECORDER, SENSORS, Port, VehiclePorts
from arena.schema.profile import Profile
from arena.schema.relative_sensors import BeaconSensor, Neighbours
from arena.schema.source import Source
from arena.schema.tools import RestartMode, Tool
from arena.transport import ConnectionUrl

Value = object
Autopilot = Literal["builtin", "px4", "hardware", "hitl"]


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Value of one key, and where it was set: `arena.yaml:14`, `default`, `profile iris` or `--set`."""

    value: Value
    source: str


@dataclass(frozen=True, kw_only=True)
class Px4:
    """A PX4 SITL that is installed on this computer.

    argv: first part of the command line, which starts with the absolute path of the binary.
    data: folder `etc` with PX4's startup scripts.
    version: release found in the binary; "" if unknown.
    home: folder in which PX4 was found.
    source: setting that names this folder.
    stand_in: true for arena's PX4 stand-in (`arena.autopilot.sitl_standin`) instead of PX4.
    """

    argv: tuple[str, ...]
    data: str
    version: str
    home: str
    source: str
    stand_in: bool = False

    @property
    def words(self) -> str:
        """Name of this PX4 for messages: `PX4` with its version, or `arena's stand-in for PX4`.

        The stand-in is the built-in autopilot with PX4's simulator API, for computers without PX4.
        """
        return (
            "arena's stand-in for PX4" if self.stand_in else f"PX4 {self.version or 'of an unknown version'}"
        )


@dataclass(frozen=True, kw_only=True)
class Fence:
    """Geofence box in which the vehicles' centres must stay. The margin is already subtracted.

    north, east: lowest and highest coordinate [m] [NED].
    up: height above the floor [m].
    """

    north: tuple[float, float]
    east: tuple[float, float]
    up: float

    def slice(self) -> dict[str, Any]:
        """Return the geofence as a JSON object for the configuration files (slices) of processes."""
        return {"north": list(self.north), "east": list(self.east), "up": self.up}

    def farthest(self, north: float, east: float) -> float:
        """Return the horizontal distance [m] from the point (north, east) to the farthest corner of the box."""
        return max(math.dist((north, east), corner) for corner in itertools.product(self.north, self.east))


@dataclass(frozen=True, kw_only=True)
class Program:
    """The user program of a vehicle.

    path: absolute path of the program.
    group: name of the group whose programs run in one process; "" for a process of its own.
    once: whether one program flies all vehicles of the group.
    clock: `simulation` if the program follows simulation time, `wall` if it uses the wall clock.
    needs: names of tools that must be ready first.
    """

    path: str
    args: tuple[str, ...] = ()
    restart: RestartMode = "never"
    group: str = ""
    once: bool = False
    clock: Literal["wall", "simulation"] = "simulation"
    needs: tuple[str, ...] = ()

    @property
    def is_python(self) -> bool:
        """True for a Python file (.py), which arena starts with Python. False for other executables."""
        return self.path.endswith(".py")


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Vehicle of the arena, with all default values filled in.

    id: MAVLink system id (MAV_SYS_ID).
    profile: vehicle profile, already changed by `overrides`.
    profile_key: name of the profile, or the absolute path of its file.
    autopilot: autopilot that is used.
    asked: autopilot that the YAML asks for, such as `auto`.
    position: lowest point of the vehicle at the start: north, east, down [m] [NED].
    rpy_deg: roll, pitch, yaw at the start [deg].
    gcs: addresses of additional ground stations.
    own_params: PX4 parameters that the user sets; `arena.plan.firmware` makes the complete set.
    overrides: mass and sensor noise from the YAML that replace the profile's.
    wind_m_s: wind at this vehicle [m/s] [NED]; None: the world's wind.
    forward: whether a pose forwarder sends poses to the autopilot, pose_rate_hz times per second.
    backend: library with which the program's `UAV` sends setpoints and commands.
    neighbours: names of the other vehicles that the sensor for neighbours measures, without the vehicle itself.
    neighbour_sensor: settings of this sensor.  beacon_sensor: settings of the sensor for beacons; None: no such sensor.
    wire: connection to a real flight controller; None if the autopilot runs on this computer.
    uid: hardware uid of the real flight controller in hexadecimal digits; "none": it reports no uid; "": any.
    sticks: whether a simulated vehicle has an RC transmitter.
    radio: `required` if a hardware vehicle has a pilot with an RC transmitter; always `none` for other vehicles.
    key_file: absolute path of the file with the vehicle's signing key; "" if its messages are not signed.
    measured: PX4 parameters that were measured on a hardware vehicle; they are part of own_params, too.
    px4_version: version in the PX4 binary, else the version in the YAML; "" if unknown.
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
    backend: Literal["mavlink", "mavsdk"] = "mavlink"
    neighbours: tuple[str, ...] = ()
    neighbour_sensor: Neighbours = field(default_factory=Neighbours.model_construct)
    beacon_sensor: BeaconSensor | None = None
    tools: Mapping[str, Tool]
    wire: ConnectionUrl | None = None
    uid: str = ""
    gps: bool = False
    sticks: bool = False
    radio: Radio = "none"
    key_file: str = ""
    measured: Mapping[str, Measured] = field(default_factory=dict)
    px4_version: str = ""

    def port_address(self, port: Port, address: str) -> tuple[str, int] | None:
        """Return (host, port number) of one of this vehicle's ports, or None if the vehicle does not use it.

        port: row of the port table. address: the arena's address.
        """
        if port.key == "sensors_router" and not self.has_sensors:
            return None
        if port.key in ("ground_autopilot", "ground_router") and not self.has_ground_link:
            return None
        if port.key != "wire":
            return address, getattr(self.ports, port.key)
        wire = self.wire
        return (wire.host, wire.port) if wire is not None and wire.kind == "udpin" else None

    @property
    def has_sensors(self) -> bool:
        """True if the vehicle has an emulated sensor that measures neighbours or beacons."""
        return bool(self.neighbours) or self.beacon_sensor is not None

    @property
    def has_ground_link(self) -> bool:
        """True if the autopilot has a separate MAVLink link for ground stations.

        A real flight controller has a single link for all messages.
        """
        return self.autopilot in ("builtin", "px4")

    @property
    def has_rc(self) -> bool:
        """True if the vehicle has an RC transmitter, real or simulated."""
        return self.sticks or self.radio == "required"

    @property
    def simulated(self) -> bool:
        """True if the vehicle's body is simulated. Its autopilot can still be a real flight controller (hitl)."""
        return self.autopilot != "hardware"


@dataclass(frozen=True, kw_only=True)
class Arena:
    """A validated arena.yaml with all defaults.

    PX4 parameters and processes are derived from it later, in `arena.plan`.

    file: path of the YAML as the user gave it.
    folder: absolute path of the folder of the YAML.
    address: numeric address that all local sockets bind.
    px4: the PX4 SITL in use; None if no vehicle uses PX4 SITL.
    geofence: None if the arena has no geofence.
    beacons: name -> position [m] [NED].
    source: the YAML with the line of each value, for the messages of later checks.
    origins: dotted key -> value and its source, for `arena plan --explain`.
    """

    name: str
    file: str
    folder: str
    address: str
    world: World
    sim: Sim
    mocap: Mocap
    log: LogKeys
    preflight: Preflight
    tools: Mapping[str, Tool]
    vehicles: tuple[Vehicle, ...]
    px4: Px4 | None = None
    copilot: Copilot | None = None
    geofence: Fence | None = None
    failsafe: Failsafe
    landing_speed_m_s: float | None = None
    beacons: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    source: Source = field(compare=False, repr=False)
    origins: Mapping[str, Origin] = field(default_factory=dict, repr=False)

    def vehicle(self, name: str) -> Vehicle:
        """Return the vehicle with a given name. Raises KeyError if there is no such vehicle."""
        return {v.name: v for v in self.vehicles}[name]

    @property
    def simulated(self) -> tuple[Vehicle, ...]:
        """Vehicles with a simulated body. The arrays of the simulation have one row per vehicle, in this order."""
        return tuple(v for v in self.vehicles if v.simulated)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Obstacles in the room, in the order of the YAML."""
        bodies = (given.body(name) for name, given in self.world.obstacles.items())
        return tuple(body for body in bodies if body is not None)

    @property
    def groups(self) -> dict[str, tuple[Vehicle, ...]]:
        """Groups of vehicles whose programs run in one process: group name -> vehicles in the order of the YAML."""
        names = dict.fromkeys(
            v.program.group for v in self.vehicles if v.program is not None and v.program.group
        )
        return {
            name: tuple(v for v in self.vehicles if v.program is not None and v.program.group == name)
            for name in names
        }

    @property
    def hardware(self) -> tuple[Vehicle, ...]:
        return tuple(v for v in self.vehicles if not v.simulated)

    def port_address(self, port: Port, vehicle: Vehicle | None = None) -> tuple[str, int] | None:
        """Return (host, port number) of a port of the arena or of one vehicle, or None if it is not used.

        port: row of the port table. vehicle: needed if each vehicle has such a port (`port.per_vehicle`).
        """
        if port.per_vehicle:
            return None if vehicle is None else vehicle.port_address(port, self.address)
        numbers = {
            "ground_stations": LINK_BASE,
            "recorder": RECORDER,
            "copilot": COPILOT if self.copilot is not None else None,
            "ground_station": GROUND_STATION,
            "sensors": SENSORS if any(v.has_sensors for v in self.vehicles) else None,
        }
        if port.key == "foxglove":
            return self.foxglove
        if port.key == "monitor":
            return None  # the page takes the next port if this one is taken
        number = numbers[port.key]
        return None if number is None else (self.address, number)

    @property
    def foxglove(self) -> tuple[str, int] | None:
        """Address (host, port number) of the WebSocket for Foxglove, or None without `log.foxglove` in the YAML."""
        shown = self.log.foxglove
        return None if shown is None else (shown.address or self.address, shown.port)
