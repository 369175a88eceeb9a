"""The pydantic models of arena.yaml: every section and key with its type.

They contain the defaults of sections; `resolve` contains the defaults of vehicles.

The docstring under a key is also the key's description in the reference page and in the JSON schema. Keys that are planned
but not available yet are in `NOT_YET`, with what to use instead. They are refused, never ignored.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema

from arena.schema.base import Address, NotNegative, Port, Positive, PositiveVector, Strict, Vector
from arena.schema.copilot import Copilot
from arena.schema.failsafe import Failsafe, Geofence
from arena.schema.hardware_uid import HardwareUid
from arena.schema.known_tools import KNOWN, KNOWN_OF_VEHICLE, known_tools, known_tools_of_vehicle
from arena.schema.log_keys import LogKeys
from arena.schema.measured import Measured
from arena.schema.mocap import Mocap
from arena.schema.obstacle import Obstacle
from arena.schema.relative_sensors import BeaconSensor, Neighbours, neighbours_value
from arena.schema.signing import Signing
from arena.schema.tools import RestartMode, Tool, Words
from arena.wire.mavlink_ids import LARGEST_VEHICLE_ID


def _speed(value: Any) -> float | Literal["max"]:
    if value == "max":
        return "max"
    if isinstance(value, (int, float)) and not isinstance(value, bool) and 0.0 < value <= 1000.0:
        return float(value)
    raise ValueError("expected a number above 0 and at most 1000, or max")


def _px4_version(text: str) -> str:
    if not re.fullmatch(r"v?1\.\d{1,2}(\.\d{1,3})?", text):
        raise ValueError("expected a PX4 version such as 1.16")
    return text.removeprefix("v")


def _program(value: Any) -> Any:
    if value is None or isinstance(value, (dict, Program)):
        return value
    if isinstance(value, str):
        return {"path": value}
    raise ValueError(
        "expected the path of a program, or a mapping with the keys path, args, restart, clock, needs, group and run"
    )


Speed = Annotated[
    float | Literal["max"],
    BeforeValidator(_speed),
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0, "maximum": 1000}, {"const": "max"}]}),
]
Radio = Literal["required", "none"]
AxesCheck = Literal["required", "none"]
GroupName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
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
    ceiling: bool = True
    """false: the room is open to the sky. Else a simulated vehicle that touches the ceiling has crashed."""
    heading_deg: Degrees = 0.0
    """Direction of the arena's north axis, clockwise from true north [deg]; affects magnetometer, GPS and global position only."""
    origin: Origin = Origin.model_construct()
    """Global position of the floor's centre. It also determines the magnetic field."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    """Seed of all random noise that the world simulates."""
    wind_m_s: Vector = (0.0, 0.0, 0.0)
    """Steady wind: north, east, down [m/s]."""
    gusts_m_s: NotNegative = 0.0
    """Random gusts (Dryden, MIL-F-8785C): wind speed 6 m above the ground that makes them [m/s]. Light 8, moderate 15, severe 23."""
    obstacles: dict[str, Obstacle] = Field(default_factory=dict)
    """Fixed obstacles of the room, by name. A simulated vehicle that touches an obstacle has crashed."""
    downwash: NotNegative = 1.0
    """Factor of the downwash between simulated vehicles whose profile has `downwash` [-]. 0: none."""


class Sim(Strict):
    """Settings of the simulation: rates, speed, window."""

    physics_hz: Annotated[int, Field(ge=100, le=10000)] = 500
    """Physics steps per second."""
    sensor_hz: Annotated[int, Field(ge=50, le=1000)] = 250
    """Sensor samples and autopilot steps per second; must divide physics_hz."""
    speed: Speed = 1.0
    """Simulated seconds per second, or `max`."""
    processes: Literal["auto", "one", "many"] = "auto"
    """Processes of a simulated arena. `one`: a process for all its parts: faster, and repeatable. `many`: a process for each part, as with
    real vehicles. `auto`: `one` if no vehicle has a real flight controller, and `speed` is not 1 or 5 vehicles
    or more all have the built-in autopilot. PX4 SITL always has its own process."""
    gui: bool = False
    """Show pybullet's window."""
    realtime: bool = False
    """Run the world at a higher priority than other programs (nice -10; needs root or CAP_SYS_NICE)."""


class Px4Keys(Strict):
    """Settings of PX4 SITL on this computer."""

    home: str | None = None
    """PX4's source, build or installation folder, or `stand-in` for arena's PX4 stand-in. Default: $PX4_HOME, else `px4` on PATH."""


class Preflight(Strict):
    """Conditions for arming a real flight controller (autopilot `hardware` or `hitl`)."""

    position_m: Positive = 0.2
    """Largest distance between the motion capture position and the autopilot's estimate [m]."""
    yaw_deg: Annotated[float, Field(gt=0, le=180)] = 15.0
    """Largest difference between the motion capture yaw and the autopilot's estimate [deg]."""
    tilt_deg: Annotated[float, Field(gt=0, le=180)] = 10.0
    """Largest angle between the captured direction down and that of the autopilot's accelerometer at rest [deg]."""
    pose_age_s: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Largest age of the last pose sent to the vehicle [s]."""
    battery: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Lowest battery charge, from 0 to 1. Use 0 for a vehicle that does not measure its charge."""
    axes_check: AxesCheck = "required"
    """Identity and axes check of hardware by hand (`arena preflight`). `none`: it arms without; wrong axes are then not found."""
    params: bool = True
    """Which parameters hardware must have. true: all that `arena params push` writes; false: only those under `params`."""


class Host(Strict):
    """Another computer that runs part of the arena."""

    address: Address
    """Numeric address of the computer."""
    user: str | None = None
    """User name for the login."""


class Program(Strict):
    """The user's program of one vehicle."""

    path: str
    """Path of the program, relative to arena.yaml."""
    args: Words = ()
    """Command-line arguments. They can contain [placeholders](placeholders.md) such as `{mavlink_url}`."""
    restart: RestartMode = "never"
    """When to start the program again after it has ended. A program whose real vehicle was armed is not started again."""
    needs: Words = ()
    """Names of tools that must be ready first, such as `tool.bag`, in addition to the processes that serve the vehicle."""
    group: GroupName | None = None
    """Name of a group: the programs of all vehicles of a group run in one process. The program must be a Python file."""
    clock: Literal["wall", "simulation"] | None = None
    """Time that the program uses: `simulation` for `arena.UAV` and others that follow simulation time. With `wall`, `sim.speed` is 1.
    Default: `simulation` for a `.py` file, `wall` for another executable."""
    run: Literal["each", "once"] = "each"
    """`each`: the program runs once for each vehicle of the group. `once`: it runs once and flies all of them (`UAV.all_from_args`)."""


class Grid(Strict):
    """Grid of start positions for a range of vehicles such as `uav1..uav48`. Rows are filled one after the other."""

    columns: Annotated[int, Field(ge=1, le=250)]
    """Number of vehicles in a row. A row runs to the east."""
    spacing_m: Annotated[float, Field(gt=0, le=100)] = 1.0
    """Distance between two columns, and between two rows [m]. The next row is farther south."""


class Start(Strict):
    """Pose of a vehicle when the arena starts."""

    position: Vector = (0.0, 0.0, 0.0)
    """North, east, down of the vehicle's lowest point [m]; D = 0 is on the floor."""
    rpy_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw [deg]."""
    grid: Grid | None = None
    """Only for a range of vehicles: its first vehicle stands at `position`, the others in a grid. Default: all at `position`."""


class VehicleDefaults(Strict):
    """Keys that can be written under one vehicle, or under `defaults` for all vehicles.

    A key that is not given is None.
    """

    profile: str | None = None
    """Vehicle type: a name in `profiles/`, or a file. Default `iris`; hardware needs this key."""
    autopilot: Literal["auto", "builtin", "px4", "hardware", "hitl"] | None = None
    """Autopilot of the vehicle. Default `auto`: PX4 if it is found, else the built-in autopilot."""
    mass_kg: Positive | None = None
    """Mass [kg]; does not change the inertia. Default: the profile's mass."""
    sensors: dict[str, dict[str, float]] | None = None
    """Sensor noise of a simulated vehicle that replaces the profile's: `imu`, `baro`, `mag`, `gps`, with the profile's keys."""
    wind_m_s: Vector | None = None
    """Steady wind at this simulated vehicle: north, east, down [m/s]. Default: `world.wind_m_s`."""
    start: Start | None = None
    """Pose when the arena starts. Default: at the origin."""
    gcs: tuple[Address, ...] | None = None
    """Addresses of other computers with a ground station. MAVLink goes to their UDP port 14550 and the vehicle's program and SDK ports."""
    params_file: str | None = None
    """A file of PX4 parameters in QGroundControl's format, relative to arena.yaml. Values under `params` replace those of the file."""
    params: dict[str, float] | None = None
    """PX4 parameters: name and value. A vehicle's values are merged with those of `defaults`, name by name."""
    px4_version: Annotated[str | None, AfterValidator(_px4_version)] = None
    """PX4 version of a hardware vehicle, 1.9 to 1.18. Parameter names follow this version. Default 1.16."""
    gps: bool | None = None
    """true: a simulated PX4 has GPS reception. Default false."""
    sticks: bool | None = None
    """true: a simulated vehicle has an RC transmitter, with centred sticks, and ignores joysticks. Default false: a person may fly it
    with a joystick of a ground station or with `arena fly`."""
    radio: Radio | None = None
    """The pilot's RC transmitter of a hardware vehicle. Default `required`: without RC and a tested kill switch it does not arm."""
    forward: bool | None = None
    """true: a pose forwarder sends captured poses to the autopilot. Default true."""
    pose_rate_hz: Positive | None = None
    """Poses per second to the autopilot; must divide mocap.rate_hz. Default: the highest divisor up to 60."""
    program: Annotated[Program | None, BeforeValidator(_program)] = None
    """The user's program: a path, or a mapping with the keys path, args, restart, clock, needs, group and run. Default: none."""
    args: Words | None = None
    """Arguments of the program. They can contain [placeholders](placeholders.md) such as `{mass_kg}`."""
    backend: Literal["mavlink", "mavsdk"] | None = None
    """Library with which the program's `UAV` sends setpoints and commands: pymavlink or MAVSDK. Default `mavlink`."""
    neighbours: Annotated[Neighbours | None, BeforeValidator(neighbours_value)] = None
    """Sensor for other vehicles: a list of their names, or a mapping with the keys vehicles, source, rate_hz and noise. Default: none."""
    beacon_sensor: BeaconSensor | None = None
    """Sensor for `beacons`: distances and directions. Default: none; `beacon_sensor: {}` measures all beacons."""
    tools: Annotated[dict[str, Tool | None] | None, BeforeValidator(known_tools_of_vehicle)] = None
    """Commands that run beside this vehicle. `mavros: true` is MAVROS. false removes one of `defaults`."""


class VehicleKeys(VehicleDefaults):
    """All keys of one vehicle: the keys of `defaults`, and individual keys such as `id`."""

    id: Annotated[int | None, Field(ge=1, le=LARGEST_VEHICLE_ID)] = None
    """MAVLink system id (MAV_SYS_ID). Default: the lowest free id, in the order of the YAML."""
    port: Port | None = None
    """UDP port that receives the vehicle's MAVLink in the program. The SDK's port is this number + 6000. Default: 16000 + id."""
    mocap_body: str | None = None
    """Name of the vehicle's rigid body in the motion capture. Default: the vehicle's name."""
    url: str | None = None
    """Connection to a hardware autopilot: udpin:HOST:PORT, udpout:HOST:PORT or serial:DEVICE."""
    serial: str | None = None
    """Serial device of a flight controller in the loop (`autopilot: hitl`)."""
    uid: HardwareUid | None = None
    """Hardware uid of a real autopilot, hexadecimal; none: it reports no uid. Default: the first one that answers in a run."""
    measured: dict[str, Measured] | None = None
    """PX4 parameters that were measured on this hardware vehicle: name -> value, date, how. `arena params measured` shows them."""
    signing: Signing | None = None
    """MAVLink message signing of a hardware vehicle. Default: messages are not signed."""
    baud: Annotated[int | None, Field(ge=1200, le=12_000_000)] = None
    """Baud rate of a serial connection to an autopilot. Default 921600."""


class ArenaFile(Strict):
    """A whole arena.yaml."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")] | None = None
    """Name of the arena. Default: the name of its folder."""
    address: Address = "127.0.0.1"
    """Numeric address that all processes bind. Default: 127.0.0.1, or the next free loopback address."""
    world: World = World.model_construct()
    """The room."""
    sim: Sim = Sim.model_construct()
    """The simulation."""
    mocap: Mocap = Mocap.model_construct()
    """The motion capture."""
    log: LogKeys = LogKeys.model_construct()
    """The log of a flight."""
    px4: Px4Keys = Px4Keys.model_construct()
    """The PX4 for vehicles with `autopilot: px4` or `auto`."""
    preflight: Preflight = Preflight.model_construct()
    """Conditions for arming a real flight controller."""
    failsafe: Failsafe = Failsafe.model_construct()
    """Reactions of the autopilots to failures and lost connections."""
    landing_speed_m_s: Annotated[float | None, Field(ge=0.3, le=2)] = None
    """Landing speed of every vehicle [m/s]. Default: the autopilot's own value (PX4: 0.7)."""
    geofence: Geofence | None = None
    """Box that the vehicles must stay in. Default: none; `geofence: {}` is the whole room."""
    copilot: Copilot | None = None
    """The process that watches the vehicles in flight. Default: none; `copilot: {}` enables all rules with their defaults."""
    beacons: dict[str, Vector] = Field(default_factory=dict)
    """Beacons in the room: name -> north, east, down [m]. A vehicle measures them with `beacon_sensor`."""
    hosts: dict[str, Host] = Field(default_factory=dict)
    """Other computers that run part of the arena."""
    defaults: VehicleDefaults = VehicleDefaults.model_construct()
    """Values of vehicle keys for all vehicles. A key under the vehicle itself replaces them."""
    tools: Annotated[dict[str, Tool], BeforeValidator(known_tools)] = Field(default_factory=dict)
    """Commands that run beside the arena. `monitor: true` is the page of `arena monitor`, `ros2: true` the bridge to ROS 2,
    `microxrce: true` the agent for PX4's ROS 2 topics, `bag: true` a recorder of ROS 2 topics, `qgroundcontrol: true` QGroundControl."""
    vehicles: Annotated[dict[str, VehicleKeys], Field(min_length=1)]
    """The vehicles, by name. A name `uav1..uav48` stands for 48 vehicles with the same keys."""


NOT_YET: Mapping[tuple[str, str | None], str] = {
    ("hosts", None): "Remove it; everything runs on this computer",
    ("mocap.source", "vrpn"): "Use emulator or natnet",
}
"""Keys and values of the models that are not available yet: (dotted key, value or None for every value) -> what to use instead."""

_SENSORS = "Simulated vehicles have an IMU, a barometer, a magnetometer and GPS"
PLANNED_KEYS: Mapping[str, str] = {
    "camera": _SENSORS,
    "cameras": _SENSORS,
    "host": "Everything runs on this computer",
    "lidar": _SENSORS,
    "rangefinder": _SENSORS,
}
"""Keys of features that do not exist yet -> what to use instead."""
OTHER_NAMES: Mapping[str, str] = {
    "objects": "Use `world.obstacles`",
    "payload_kg": "Set `mass_kg` of the vehicle",
    "ray": "Give the Ray cluster with `arena campaign --cluster ADDRESS`",
    "ros": "Write `tools: {ros2: true}`, or use MAVLink at the vehicle's SDK port",
}
"""Keys that a user may look for and that do not exist, because the feature has another name -> what to use."""
LIST_ITEMS: Mapping[tuple[str, str], str] = {
    ("world", "size"): "north, east, height [m]",
    ("world", "wind_m_s"): "wind to the north, east, down [m/s]",
    ("start", "position"): "north, east, down [m]",
}
"""Items of the lists of 3 numbers: last two parts of the key -> names of the items with their unit, for messages."""
PLANNED_VALUES: Mapping[tuple[str, str], str] = {
    ("autopilot", "ardupilot"): "Use px4 or builtin",
    ("source", "qualisys"): "Use emulator or natnet",
    ("source", "vicon"): "Use emulator or natnet",
}
"""Values that a user may look for and that do not exist yet: (last part of the key, value) -> what to use instead."""


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of arena.yaml (JSON Schema draft 2020-12)."""
    from arena.schema.descriptions import add_descriptions

    made = ArenaFile.model_json_schema()
    add_descriptions(made, ArenaFile)
    made["properties"]["tools"]["properties"] = _known_tools_schema(KNOWN, made["$defs"])
    for name in ("VehicleKeys", "VehicleDefaults"):
        vehicle_tools = made["$defs"][name]["properties"]["tools"]["anyOf"][0]
        vehicle_tools["properties"] = _known_tools_schema(KNOWN_OF_VEHICLE, made["$defs"])
        made["$defs"][name]["properties"]["program"]["anyOf"].insert(0, {"type": "string"})
        made["$defs"][name]["properties"]["neighbours"]["anyOf"].insert(
            0, {"type": "array", "items": {"type": "string"}}
        )
    shown = made["$defs"]["LogKeys"]["properties"]["foxglove"]["anyOf"]
    shown[:0] = [{"type": "boolean"}, {"type": "integer", "minimum": 1024, "maximum": 65535}]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **made, "title": "arena.yaml"}


def _known_tools_schema(names: Iterable[str], defs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON schema of tools that arena knows by name.

    Their value is true, false, the settings of the tool, or a full `Tool`.
    """

    def references(name: str) -> Iterator[dict[str, str]]:
        for each in (name.capitalize(), "Tool"):
            if each in defs:
                yield {"$ref": f"#/$defs/{each}"}

    return {name: {"anyOf": [{"type": "boolean"}, *references(name)]} for name in names}
