"""Converts MAVLink setpoints to calls of MAVSDK's Offboard plugin, and compares sent with requested setpoints.

MAVSDK uses degrees. Setpoints that the Offboard plugin cannot send go through the MavlinkDirect plugin, whose input is JSON.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.offboard import (
    AccelerationNed,
    Attitude,
    AttitudeRate,
    Offboard,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import euler_from_quat
from arena.uav.setpoints import Ignore, IgnoreAttitude

SETPOINTS = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
    )
)
"""Ids of the messages that are setpoints."""
_TOLERANCE = 1e-4  # MAVSDK converts degrees and quaternions with 32-bit floats
_LOCAL_FIELDS = (
    (Ignore.POSITION, ("x", "y", "z")),
    (Ignore.VELOCITY, ("vx", "vy", "vz")),
    (Ignore.ACCELERATION, ("afx", "afy", "afz")),
    (Ignore.YAW, ("yaw",)),
    (Ignore.YAW_RATE, ("yaw_rate",)),
)


def send(offboard: Offboard, direct: MavlinkDirect, own: tuple[int, int], message: Any) -> None:
    """Pass one setpoint to MAVSDK, which sends it at once.

    own: system and component id of the program. message: setpoint of `Encoder`.
    """
    kind = message.get_msgId()
    if kind == mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
        call = _LOCAL.get((message.coordinate_frame, message.type_mask))
    elif kind == mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
        call = _ATTITUDE.get(message.type_mask)
    else:
        call = None
    if call is None:
        direct.send_message(as_json(own, message))
    else:
        call(offboard, message)


def as_json(own: tuple[int, int], message: Any) -> MavlinkMessage:
    """Convert a pymavlink message to a message for MAVSDK's plugin MavlinkDirect, with its fields as JSON.

    own: system and component id of the program.
    """
    fields = {name: getattr(message, name) for name in message.get_fieldnames()}
    return MavlinkMessage(
        message.get_type(), *own, message.target_system, message.target_component, json.dumps(fields)
    )


def same_setpoint(asked: Any, sent: Any) -> bool:
    """Return whether two setpoints request the same motion. Times and ignored fields are not compared.

    asked: message of `Encoder`. sent: decoded message with the same id.
    """
    one, two = _meaning(asked), _meaning(sent)
    if one.keys() != two.keys():
        return False
    return all(_close(key, value, two[key]) for key, value in one.items())


def _close(field: str, one: float, two: float) -> bool:
    apart = math.remainder(one - two, math.tau) if field == "yaw" else one - two
    return abs(apart) <= _TOLERANCE * (1.0 + abs(one))


def _meaning(message: Any) -> Mapping[str, float]:
    """Return the fields that the autopilot must use in a setpoint: field -> value."""
    if hasattr(message, "coordinate_frame"):
        found = {"frame": message.coordinate_frame, "mask": message.type_mask}
        for ignored, names in _LOCAL_FIELDS:
            if not message.type_mask & ignored:
                found |= {name: getattr(message, name) for name in names}
        return found
    if hasattr(message, "q"):
        return _attitude_meaning(message)
    controls = {f"control {i}": value for i, value in enumerate(message.controls)}
    return {"group": message.group_mlx, **controls}


def _attitude_meaning(message: Any) -> Mapping[str, float]:
    found = {"mask": message.type_mask, "thrust": message.thrust}
    if not message.type_mask & IgnoreAttitude.ATTITUDE:
        sign = math.copysign(1.0, next((v for v in message.q if abs(v) > _TOLERANCE), 1.0))
        found |= {f"q{i}": sign * value for i, value in enumerate(message.q)}
    if not message.type_mask & IgnoreAttitude.RATES:
        found |= {name: getattr(message, f"body_{name}_rate") for name in ("roll", "pitch", "yaw")}
    return found


def _position(m: Any) -> PositionNedYaw:
    return PositionNedYaw(m.x, m.y, m.z, math.degrees(m.yaw))


def _velocity(m: Any) -> VelocityNedYaw:
    return VelocityNedYaw(m.vx, m.vy, m.vz, math.degrees(m.yaw))


def _set_attitude(offboard: Offboard, m: Any) -> None:
    import numpy as np

    roll, pitch, yaw = np.degrees(euler_from_quat(np.array(m.q, dtype=np.float64)))
    offboard.set_attitude(Attitude(float(roll), float(pitch), float(yaw), m.thrust))


def _set_rates(offboard: Offboard, m: Any) -> None:
    rates = (math.degrees(r) for r in (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate))
    offboard.set_attitude_rate(AttitudeRate(*rates, m.thrust))


def _set_body_velocity(offboard: Offboard, m: Any) -> None:
    offboard.set_velocity_body(VelocityBodyYawspeed(m.vx, m.vy, m.vz, math.degrees(m.yaw_rate)))


def _set_full(offboard: Offboard, m: Any) -> None:
    acc = AccelerationNed(m.afx, m.afy, m.afz)
    offboard.set_position_velocity_acceleration_ned(_position(m), _velocity(m), acc)


_Call = Callable[[Offboard, Any], object]
_NED, _BODY = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_NED
_LOCAL: dict[tuple[int, int], _Call] = {
    (_NED, Ignore.VELOCITY | Ignore.ACCELERATION | Ignore.YAW_RATE): lambda o, m: o.set_position_ned(
        _position(m)
    ),
    (_NED, Ignore.POSITION | Ignore.ACCELERATION | Ignore.YAW_RATE): lambda o, m: o.set_velocity_ned(
        _velocity(m)
    ),
    (_NED, Ignore.ACCELERATION | Ignore.YAW_RATE): lambda o, m: o.set_position_velocity_ned(
        _position(m), _velocity(m)
    ),
    (_NED, Ignore.YAW_RATE): _set_full,
    (_BODY, Ignore.POSITION | Ignore.ACCELERATION | Ignore.YAW): _set_body_velocity,
}
"""(coordinate_frame, type_mask) of a setpoint -> the call of the Offboard plugin that sends it."""
_ATTITUDE: dict[int, _Call] = {
    IgnoreAttitude.RATES: _set_attitude,
    IgnoreAttitude.ATTITUDE: _set_rates,
}
"""type_mask of SET_ATTITUDE_TARGET -> the call of the Offboard plugin that sends the setpoint."""
