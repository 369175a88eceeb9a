"""Numeric messages for Foxglove and PlotJuggler: their ROS 2 definitions. `arena.kernels.viewer_messages` encodes them as CDR bytes.

Both programs plot every numeric field of such a message. Positions and velocities are NED, body rates and accelerations FRD, angles
radians. A value that is not known is NaN. The bytes contain float32, as the MAVLink messages from which most values come.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from arena.constants import MAX_ROTORS

ENCODING, SCHEMA_ENCODING = "cdr", "ros2msg"
_LITTLE_ENDIAN = b"\0\1\0\0"


@dataclass(frozen=True, kw_only=True)
class NumberMessage:
    """Message for Foxglove and PlotJuggler that consists of numbers only.

    name: name of the ROS 2 message.  summary: first line of the schema.
    fields: name of each field -> its meaning with unit.
    """

    name: str
    summary: str
    fields: Mapping[str, str]

    @property
    def schema(self) -> str:
        """Return the definition of the message as the text of a ROS 2 .msg file."""
        width = max(map(len, self.fields))
        lines = [f"float32 {name:{width}}  # {meaning}" for name, meaning in self.fields.items()]
        return "\n".join((f"# {self.summary}", *lines, ""))


def _axes(prefix: str, meaning: str) -> dict[str, str]:
    return {f"{prefix}{axis}": meaning for axis in ("north", "east", "down")}


_EULER = {name: f"{name} [rad]" for name in ("roll", "pitch", "yaw")}
_QUATERNION = {f"q_{part}": "attitude, body FRD to NED [-]" for part in "wxyz"}
_RATES = {f"{name}_rate": "body rate [rad/s]" for name in ("roll", "pitch", "yaw")}

LOCAL_POSITION = NumberMessage(
    name="arena_msgs/msg/LocalPosition",
    summary="Estimated position and velocity, from LOCAL_POSITION_NED",
    fields=_axes("", "position [m]") | _axes("v_", "velocity [m/s]"),
)
ATTITUDE = NumberMessage(
    name="arena_msgs/msg/Attitude",
    summary="Estimated attitude and body rates, from ATTITUDE_QUATERNION",
    fields=_QUATERNION | _EULER | _RATES,
)
POSITION_SETPOINT = NumberMessage(
    name="arena_msgs/msg/PositionSetpoint",
    summary="Position, velocity and yaw to follow, from POSITION_TARGET_LOCAL_NED; NaN: not controlled",
    fields=_axes("", "position [m]") | _axes("v_", "velocity [m/s]") | {"yaw": "yaw [rad]"},
)
ATTITUDE_SETPOINT = NumberMessage(
    name="arena_msgs/msg/AttitudeSetpoint",
    summary="Attitude, body rates and thrust to follow, from ATTITUDE_TARGET",
    fields=_QUATERNION | _EULER | _RATES | {"thrust": "collective thrust, 0..1 [-]"},
)
ACTUATORS = NumberMessage(
    name="arena_msgs/msg/Actuators",
    summary="Motor outputs, from SERVO_OUTPUT_RAW",
    fields={f"rotor{k}": "output, 0..1 [-]" for k in range(1, MAX_ROTORS + 1)},
)
IMU = NumberMessage(
    name="arena_msgs/msg/Imu",
    summary="Inertial measurement, magnetic field and barometer, from HIGHRES_IMU",
    fields={f"accel_{axis}": "specific force [m/s2]" for axis in "xyz"}
    | {f"gyro_{axis}": "body rate [rad/s]" for axis in "xyz"}
    | {f"mag_{axis}": "magnetic field [gauss]" for axis in "xyz"}
    | {"pressure": "[hPa]", "pressure_altitude": "[m]", "temperature": "[deg C]"},
)
BATTERY = NumberMessage(
    name="arena_msgs/msg/Battery",
    summary="Battery, from SYS_STATUS",
    fields={"voltage": "[V]", "current": "[A]", "remaining": "remaining charge [%]"},
)
ESTIMATOR = NumberMessage(
    name="arena_msgs/msg/EstimatorStatus",
    summary="Health of the autopilot's estimator, from ESTIMATOR_STATUS. A test ratio above 1: the measurement was rejected",
    fields={
        f"{name}_ratio": f"innovation test ratio of the {meaning} [-]"
        for name, meaning in {
            "velocity": "velocity",
            "horizontal": "horizontal position",
            "vertical": "vertical position",
            "mag": "magnetometer",
            "height": "height above ground",
        }.items()
    }
    | {
        "horizontal_accuracy": "standard deviation of the horizontal position [m]",
        "vertical_accuracy": "standard deviation of the vertical position [m]",
        "flags": "ESTIMATOR_STATUS_FLAGS",
    },
)
WIND = NumberMessage(
    name="arena_msgs/msg/Wind",
    summary="Estimated wind, from WIND_COV",
    fields=_axes("", "wind velocity [m/s]"),
)
LINK = NumberMessage(
    name="arena_msgs/msg/LinkRates",
    summary="MAVLink traffic of a vehicle over the last period",
    fields={
        "down": "datagrams from the vehicle [1/s]",
        "up": "datagrams to the vehicle [1/s]",
        "down_bytes": "bytes from the vehicle [1/s]",
        "up_bytes": "bytes to the vehicle [1/s]",
        "lost": "messages of the autopilot missing in its sequence numbers [1/s]",
    },
)
BODY_HEALTH = NumberMessage(
    name="arena_msgs/msg/BodyHealth",
    summary="Poses of a vehicle in the motion capture over the last period",
    fields={
        "rate": "tracked poses [1/s]",
        "age": "time since the last tracked pose [s]",
        "gap": "longest time between two tracked poses [s]",
    },
)
MOCAP_HEALTH = NumberMessage(
    name="arena_msgs/msg/MocapHealth",
    summary="Frames of the motion capture over the last period",
    fields={
        "rate": "frames [1/s]",
        "lost": "frames missing in the frame numbers [1/s]",
        "gap": "longest time between two frames [s]",
    },
)

STATE_NAME = "arena_msgs/msg/VehicleState"
STATE_SCHEMA = """\
# Flight mode, arming and landed state of a vehicle, from HEARTBEAT and EXTENDED_SYS_STATE
string mode    # PX4's name of the flight mode
bool armed
bool landed    # on the ground, according to the land detector
string health  # MAV_STATE of the autopilot, such as ACTIVE
"""
FAULT_NAME = "arena_msgs/msg/Fault"
FAULT_SCHEMA = """\
# Injected fault
string fault   # the fault with its values, such as: wind 3 0 0 m/s
string process # the process that simulates the fault
"""


def pack_state(mode: str, armed: bool, landed: bool, health: str) -> bytes:
    """Encode the state of a vehicle for Foxglove and PlotJuggler. The arguments are the fields of `STATE_SCHEMA`."""
    first = _string(mode) + bytes((armed, landed))
    return _LITTLE_ENDIAN + first + bytes(-len(first) % 4) + _string(health)


def pack_fault(fault: str, process: str) -> bytes:
    """Encode an injected fault for Foxglove and PlotJuggler. The arguments are the fields of `FAULT_SCHEMA`."""
    first = _string(fault)
    return _LITTLE_ENDIAN + first + bytes(-len(first) % 4) + _string(process)


def _string(text: str) -> bytes:
    """Return a text as a CDR string.

    It is the number of bytes with the final zero byte, then the bytes.
    """
    data = text.encode() + b"\0"
    return len(data).to_bytes(4, "little") + data
