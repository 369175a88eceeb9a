"""The models of arena.yaml, key by key. Defaults of the sections are here; those of a vehicle are in `resolve`.

A docstring under a key is its line in the reference page and in the JSON schema. Keys that are known but not built yet are in
`NOT_YET` with what to use instead: they are refused, never ignored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from arena.schema.base import Address, NotNegative, Port, Positive, PositiveVector, Span, Strict, Vector
from arena.schema.copilot import Copilot
from arena.schema.mocap import Mocap


def _speed(value: Any) -> float | Literal["max"]:
    if value == "max":
        return "max"
    if isinstance(value, (int, float)) and not isinstance(value, bool) and 0.0 < value <= 1000.0:
        return float(value)
    raise ValueError("a number above 0 to 1000, or max")


def _px4_version(text: str) -> str:
    if not re.fullmatch(r"v?1\.\d{1,2}(\.\d{1,3})?", text):
        raise ValueError("a PX4 version such as 1.16")
    return text.removeprefix("v")


def _program(value: Any) -> Any:
    if value is None or isinstance(value, (dict, Program)):
        return value
    if isinstance(value, str):
        return {"path": value}
    raise ValueError("a path, or a mapping of path, args and restart")


Speed = Annotated[
    float | Literal["max"],
    BeforeValidator(_speed),
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0, "maximum": 1000}, {"const": "max"}]}),
]
Words = tuple[str, ...]
RestartMode = Literal["never", "on_failure", "always"]
Degrees = Annotated[float, Field(ge=-360, le=360)]


class Origin(Strict):
    """The global position of the arena's origin."""

    lat_deg: Annotated[float, Field(ge=-90, le=90)] = 47.397742
    """Latitude [deg]."""
    lon_deg: Annotated[float, Field(ge=-180, le=180)] = 8.545594
    """Longitude [deg]."""
    alt_m: Annotated[float, Field(ge=-500, le=9000)] = 488.0
    """Height above the sea [m]."""


class World(Strict):
    """The room that the vehicles fly in."""

    size: PositiveVector = (7.0, 4.0, 3.0)
    """North, east and height of the room [m]."""
    heading_deg: Degrees = 0.0
    """Where the arena's north points [deg]; turns only magnetometer, GPS and global position."""
    origin: Origin = Origin()
    """Where on the earth the floor's centre is."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    """Seed of every simulated noise of the world."""
    wind_m_s: Vector = (0.0, 0.0, 0.0)
    """Steady wind, north, east, down [m/s]."""


class Sim(Strict):
    """The simulation of the world."""

    physics_hz: Annotated[int, Field(ge=100, le=10000)] = 500
    """Physics steps per second."""
    sensor_hz: Annotated[int, Field(ge=50, le=1000)] = 250
    """Sensor samples and autopilot steps per second; divides physics_hz."""
    speed: Speed = 1.0
    """Simulated seconds per second, or `max`."""
    gui: bool = False
    """Show pybullet's window."""
    realtime: bool = False
    """Run the world at a higher priority than other programs (nice -10; needs root or CAP_SYS_NICE)."""


class Px4Keys(Strict):
    """PX4 software in the loop."""

    home: str | None = None
    """Its source, build or installation folder, or `stand-in` for arena's own. Default: $PX4_HOME, else `px4` on PATH."""


class Preflight(Strict):
    """Conditions for arming hardware, or a flight controller in the loop."""

    position_m: Positive = 0.2
    """Largest distance between the motion capture pose and the vehicle's estimate [m]."""
    yaw_deg: Annotated[float, Field(gt=0, le=180)] = 15.0
    """Largest yaw difference between the two [deg]."""
    pose_age_s: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Largest age of the last pose sent to the vehicle [s]."""
    battery: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Lowest charge, 0 to 1; 0 for a vehicle that does not measure it."""
    params: bool = True
    """Whether hardware must hold all parameters that `arena params push` writes; false: those under `params` alone."""


Share = Annotated[float, Field(gt=0, lt=1)]


class OffboardLoss(Strict):
    """Setpoints stop in OFFBOARD."""

    action: Literal["land", "hold", "return", "terminate", "disarm"] = "land"
    """What the vehicle does."""
    after_s: Annotated[float, Field(gt=0, le=60)] = 1.0
    """How long they may be missing [s]."""


class PositionLoss(Strict):
    """Poses stop, or the estimator rejects them."""

    action: Literal["land", "terminate", "disarm"] = "land"
    """What the vehicle does; `land` is straight down, by its inertial sensors."""
    after_s: Annotated[float, Field(ge=0.5, le=10)] = 1.0
    """How long they may be missing [s]."""


class LowBattery(Strict):
    """Remaining charge, from 0 to 1."""

    warn: Share = 0.15
    """Charge at which the vehicle warns."""
    land: Share | None = 0.07
    """Charge at which the vehicle lands; null: it flies on until the battery is empty."""

    @model_validator(mode="after")
    def _in_order(self) -> LowBattery:
        if self.land is not None and self.land >= self.warn:
            raise ValueError(f"land below warn; got land {self.land:g} and warn {self.warn:g}")
        return self


class RcLoss(Strict):
    """RC input stops."""

    action: Literal["none", "hold", "return", "land", "terminate", "disarm"] | None = None
    """What the vehicle does. Default: land with an RC transmitter, else none."""


class DataLinkLoss(Strict):
    """Heartbeats of ground stations stop."""

    action: Literal["none", "hold", "return", "land", "terminate", "disarm"] = "none"
    """What the vehicle does."""
    after_s: Annotated[float, Field(ge=5, le=300)] = 10.0
    """Time without a heartbeat [s]."""


class AttitudeLoss(Strict):
    """The vehicle tilts too far: hit, turned over, or with a lost rotor."""

    action: Literal["none", "terminate"] = "none"
    """What the vehicle does; `terminate` stops its motors. Not given: hardware keeps its own setting."""
    above_deg: Annotated[int, Field(ge=50, le=90)] = 60
    """Roll or pitch that counts as a failure [deg]; above the largest tilt in flight (`MPC_TILTMAX_AIR`, 45)."""


class FenceLoss(Strict):
    """A geofence is crossed: the one under `geofence`, or one that was uploaded."""

    action: Literal["none", "warn", "hold", "return", "land", "terminate"] = "land"
    """What the vehicle does."""


class Failsafe(Strict):
    """Reactions to losses. They become parameters of the vehicles' autopilots."""

    offboard_loss: OffboardLoss = OffboardLoss()
    """When setpoints stop."""
    position_loss: PositionLoss = PositionLoss()
    """When poses stop."""
    low_battery: LowBattery = LowBattery()
    """When the battery is low."""
    rc_loss: RcLoss = RcLoss()
    """When RC input stops."""
    data_link_loss: DataLinkLoss = DataLinkLoss()
    """When heartbeats of ground stations stop."""
    geofence: FenceLoss = FenceLoss()
    """When a geofence is crossed."""
    attitude: AttitudeLoss = AttitudeLoss()
    """When the attitude is lost."""


class Geofence(Strict):
    """A box that the vehicles' centres must stay in. The reaction to leaving it is `failsafe.geofence`."""

    north: Span | None = None
    """Lowest and highest north coordinate from the floor's centre [m]. Default: the room's walls."""
    east: Span | None = None
    """Lowest and highest east coordinate [m]. Default: the room's walls."""
    up: Positive | None = None
    """Height of its ceiling above the floor [m]. Default: the room's."""
    margin_m: NotNegative = 0.0
    """Distance by which walls and ceiling move inwards [m]."""


class Host(Strict):
    """Another computer that runs part of the arena."""

    address: Address
    """Its numeric address."""
    user: str | None = None
    """Who logs in there."""


class Tool(Strict):
    """A command that runs beside the arena."""

    argv: Annotated[Words, Field(min_length=1)]
    """The command and its arguments, as a list."""
    env: dict[str, str] = Field(default_factory=dict)
    """Further environment variables."""
    cwd: str | None = None
    """Where it runs; by default the folder of arena.yaml."""
    restart: RestartMode = "never"
    """Whether it is started again when it ends."""
    needs: Words | None = None
    """Names of processes that must be ready first; by default the router."""


class Program(Strict):
    """The user's program of one vehicle."""

    path: str
    """The program's file, relative to arena.yaml."""
    args: Words = ()
    """Its arguments."""
    restart: RestartMode = "never"
    """Whether it is started again when it ends."""


class Start(Strict):
    """Pose of a vehicle when the arena starts."""

    position: Vector = (0.0, 0.0, 0.0)
    """North, east, down of its lowest point [m]; D = 0 stands on the floor."""
    rpy_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw [deg]."""


class VehicleDefaults(Strict):
    """Keys of a vehicle that `defaults` may give to all of them. None: not given here."""

    profile: str | None = None
    """Vehicle type: a name in `profiles/`. Default `iris`."""
    autopilot: Literal["auto", "builtin", "px4", "hardware", "hitl"] | None = None
    """Which autopilot flies it. Default `auto`."""
    mass_kg: Positive | None = None
    """Mass [kg]; the inertia stays that of the profile. Default: the profile's."""
    sensors: dict[str, dict[str, float]] | None = None
    """Sensor noise of a simulated vehicle, over that of the profile: `imu`, `baro`, `mag`, `gps` and their keys there."""
    wind_m_s: Vector | None = None
    """Steady wind at this simulated vehicle, north, east, down [m/s]. Default: `world.wind_m_s`."""
    start: Start | None = None
    """Where it stands at first. Default: at the origin."""
    gcs: tuple[Address, ...] | None = None
    """Further computers with a ground station: each gets the vehicle's program port, SDK port and UDP 14550."""
    params_file: str | None = None
    """A file of PX4 parameters, as QGroundControl saves it, relative to arena.yaml; `params` goes before it."""
    params: dict[str, float] | None = None
    """PX4 parameters by name; merged name by name."""
    px4_version: Annotated[str | None, AfterValidator(_px4_version)] = None
    """Which PX4 a hardware vehicle runs, 1.9 to 1.18: its parameters get the names of that version. Default 1.16."""
    gps: bool | None = None
    """Whether a simulated PX4 has GPS reception. Default false."""
    sticks: bool | None = None
    """Whether a simulated vehicle has an RC transmitter, sticks centred. Default false."""
    forward: bool | None = None
    """Whether a pose forwarder feeds the autopilot. Default true."""
    pose_rate_hz: Positive | None = None
    """Poses per second to the autopilot; divides mocap.rate_hz. Default: the highest that does, up to 60."""
    program: Annotated[Program | None, BeforeValidator(_program)] = None
    """The user's program: a path, or a mapping of path, args and restart. Default: none."""
    args: Words | None = None
    """Arguments of the program."""
    neighbours: Words | None = None
    """Names of vehicles whose poses the program reads."""
    tools: dict[str, Tool] | None = None
    """Commands that run beside this vehicle."""


class VehicleKeys(VehicleDefaults):
    """Keys of a vehicle."""

    id: Annotated[int | None, Field(ge=1, le=250)] = None
    """MAV_SYS_ID. Default: the lowest that is free, in order of appearance."""
    port: Port | None = None
    """UDP port of its MAVLink for the program; the SDK's is 6000 above. Default: 16000 + id."""
    mocap_body: str | None = None
    """Its rigid body's name in the motion capture. Default: its own name."""
    url: str | None = None
    """How a hardware autopilot is reached: udpin:HOST:PORT, udpout:HOST:PORT or serial:DEVICE."""
    serial: str | None = None
    """The device of a flight controller in the loop (`autopilot: hitl`)."""
    baud: Annotated[int | None, Field(ge=1200, le=12_000_000)] = None
    """Baud rate of a serial autopilot. Default 921600."""


class ArenaFile(Strict):
    """A whole arena.yaml."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")] | None = None
    """What the arena is called. Default: the name of its folder."""
    address: Address = "127.0.0.1"
    """Numeric address that all processes bind. Default: 127.0.0.1, or the next free loopback address."""
    world: World = World()
    """The room."""
    sim: Sim = Sim()
    """The simulation."""
    mocap: Mocap = Mocap()
    """The motion capture."""
    px4: Px4Keys = Px4Keys()
    """The PX4 for vehicles with `autopilot: px4` or `auto`."""
    preflight: Preflight = Preflight()
    """Conditions for arming a real autopilot."""
    failsafe: Failsafe = Failsafe()
    """Reactions to losses."""
    landing_speed_m_s: Annotated[float | None, Field(ge=0.3, le=2)] = None
    """Of every vehicle [m/s]. Default: its autopilot's own, 0.7 for PX4."""
    geofence: Geofence | None = None
    """Where vehicles may be. Default: no fence; `{}`: the room."""
    copilot: Copilot | None = None
    """The process that watches the vehicles in flight. Default: none; `copilot: {}` has all defaults."""
    hosts: dict[str, Host] = Field(default_factory=dict)
    """Other computers."""
    defaults: VehicleDefaults = VehicleDefaults()
    """Keys of every vehicle, unless the vehicle has its own."""
    tools: dict[str, Tool] = Field(default_factory=dict)
    """Commands that run beside the arena."""
    vehicles: Annotated[dict[str, VehicleKeys], Field(min_length=1)]
    """The vehicles, by name."""


NOT_YET: Mapping[tuple[str, str | None], str] = {
    ("hosts", None): "Remove it; everything runs on this computer",
    ("mocap.source", "vrpn"): "Use emulator or natnet",
}
"""Keys and values of the models that are not available yet: (dotted key, value or None for any) -> what to use instead."""

_SENSORS = "Simulated vehicles have an IMU, a barometer, a magnetometer and GPS"
_EMPTY_ROOM = "The simulated room is empty; walls, floor and ceiling follow from `world.size`"
PLANNED_KEYS: Mapping[str, str] = {
    "camera": _SENSORS,
    "cameras": _SENSORS,
    "host": "Everything runs on this computer",
    "lidar": _SENSORS,
    "objects": _EMPTY_ROOM,
    "obstacles": _EMPTY_ROOM,
    "payload_kg": "Set `mass_kg` of the vehicle",
    "rangefinder": _SENSORS,
    "ray": "Everything runs on this computer",
    "ros": "Use MAVLink at the vehicle's SDK port",
    "ros2": "Use MAVLink at the vehicle's SDK port",
}
"""Keys that a user may look for and that do not exist yet -> what to use instead."""
PLANNED_VALUES: Mapping[tuple[str, str], str] = {
    ("autopilot", "ardupilot"): "Use px4 or builtin",
    ("source", "qualisys"): "Use emulator or natnet",
    ("source", "vicon"): "Use emulator or natnet",
}
"""(last part of the key, value) that does not exist yet -> what to use instead."""


def json_schema() -> dict[str, Any]:
    """Return the JSON schema, draft 2020-12."""
    made = ArenaFile.model_json_schema()
    for name in ("VehicleKeys", "VehicleDefaults"):
        made["$defs"][name]["properties"]["program"]["anyOf"].insert(0, {"type": "string"})
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **made, "title": "arena.yaml"}
