"""Values that telemetry messages contain, such as the estimated position.

Units are SI and radians, frames NED and FRD, quaternions wxyz.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True)
class Local:
    """Estimated position and velocity, from LOCAL_POSITION_NED.

    received_at: time of arrival [s]. boot_s: the autopilot's time [s]. pos: [m] [NED] (3,). vel: [m/s] [NED]
    (3,).
    """

    received_at: float
    boot_s: float
    pos: Array
    vel: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Attitude:
    """Estimated attitude, from ATTITUDE_QUATERNION.

    q_nb: [-] wxyz (4,). ang_vel: body rates [rad/s] [FRD] (3,).
    """

    received_at: float
    boot_s: float
    q_nb: Array
    ang_vel: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Imu:
    """Inertial measurement, from HIGHRES_IMU.

    boot_s: the autopilot's time [s]. acc_body: specific force [m/s2] [FRD] (3,). ang_vel: [rad/s] [FRD] (3,).
    """

    received_at: float
    boot_s: float
    acc_body: Array
    ang_vel: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Mag:
    """Measured magnetic field, from HIGHRES_IMU.

    mag: [T] [FRD] (3,).
    """

    received_at: float
    mag: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Baro:
    """Barometer, from HIGHRES_IMU.

    pressure: [Pa].
    temperature: [deg C].
    alt: pressure altitude [m].
    """

    received_at: float
    pressure: float
    temperature: float
    alt: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Gps:
    """Satellite position, from GPS_RAW_INT.

    pos: latitude [deg], longitude [deg], altitude above mean sea level [m] (3,).
    """

    received_at: float
    pos: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Actuators:
    """Actuator outputs, from SERVO_OUTPUT_RAW or ACTUATOR_CONTROL_TARGET.

    group: output port or mixer group. output: 0..1 [-] (8,); unused outputs are zero.
    """

    received_at: float
    group: int
    output: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class HeartbeatState:
    """Mode and arming state, from HEARTBEAT.

    mode: name of the flight mode, as returned by `mode_words`.
    """

    received_at: float
    mode: str
    armed: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class Status:
    """State of the autopilot, from SYS_STATUS.

    prearm: the vehicle can be armed in its current mode. battery: remaining charge [%], or nan.
    """

    received_at: float
    prearm: bool
    battery: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Ground:
    """Landed state, from EXTENDED_SYS_STATE.

    landed: on the ground, according to the land detector.
    """

    received_at: float
    landed: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class Reference:
    """Position reference that the autopilot follows, from POSITION_TARGET_LOCAL_NED.

    pos: [m] [NED] (3,). vel: [m/s] [NED] (3,). yaw: [rad]. Values that are not controlled are nan.
    """

    received_at: float
    boot_s: float
    pos: Array
    vel: Array
    yaw: float


@dataclass(frozen=True, kw_only=True, slots=True)
class AttitudeReference:
    """Attitude reference that the autopilot follows, from ATTITUDE_TARGET.

    q_nb: [-] wxyz (4,). ang_vel: [rad/s] [FRD] (3,). thrust: normalised 0..1 [-].
    """

    received_at: float
    boot_s: float
    q_nb: Array
    ang_vel: Array
    thrust: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Text:
    """Message text of the autopilot, from STATUSTEXT.

    severity: 0 emergency .. 7 debug.
    """

    received_at: float
    severity: int
    text: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Ack:
    """Reply of the autopilot to a command, from COMMAND_ACK.

    command: MAV_CMD. result: MAV_RESULT. target: (system, component) to which the reply is addressed, the command's sender.
    """

    received_at: float
    command: int
    result: int
    target: tuple[int, int]
