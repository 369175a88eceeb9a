"""Decodes the offboard setpoint messages that pymavlink parses, with PX4's rules for type masks, frames and refusals.

The kernel `ordinary_messages` decodes the frequent message SET_POSITION_TARGET_LOCAL_NED.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.vehicle import Vehicle

_NOT_GIVEN = (math.nan,) * 3
_POSITION_IGNORED = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
_ROLL_PITCH_RATE_IGNORED = (
    mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    | mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
)
_MIN_QUAT_NORM = 1e-3
_MAX_ABS = 1e6  # [rad/s]: a larger body rate is a mistake


def receive_setpoint(m: Any, v: Vehicle) -> str | None:
    """Store the setpoint of a SET_POSITION_TARGET_GLOBAL_INT or SET_ATTITUDE_TARGET message.

    Return None, or the reason if the setpoint is refused. The reason "" means that the refusal is not reported.
    """
    is_global = m.get_msgId() == mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
    return _receive_global_target(m, v) if is_global else _receive_attitude_target(m, v)


def _receive_global_target(m: Any, v: Vehicle) -> str | None:
    frame, p_n = m.coordinate_frame, _NOT_GIVEN
    if not m.type_mask & _POSITION_IGNORED:
        found = v.local_from_global(m.lat_int * 1e-7, m.lon_int * 1e-7, m.alt)
        if found is None or frame == mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT:
            return ""
        if frame == mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT:
            if not v.home_n:
                return ""
            found = (found[0], found[1], v.home_n[2] - m.alt)
        elif frame != mavlink.MAV_FRAME_GLOBAL_INT:
            return f"coordinate frame {frame} is not supported"
        p_n = found
    target = (*p_n, m.vx, m.vy, m.vz, m.afx, m.afy, m.afz, m.yaw, m.yaw_rate)
    for k, x in enumerate(target):
        v.offboard.target[k] = x
    return v.offboard.set_global_target(v.row, m.type_mask, v.heading, v.now)


def _receive_attitude_target(m: Any, v: Vehicle) -> str | None:
    """Store the setpoint of a SET_ATTITUDE_TARGET. If it has an attitude, its roll and pitch rates are ignored."""
    mask = m.type_mask
    by_attitude = not mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    if not by_attitude and mask & _ROLL_PITCH_RATE_IGNORED:
        return ""
    roll, pitch, yaw = (
        0.0 if mask & (1 << i) else x
        for i, x in enumerate((m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate))
    )
    if mask & mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE or not math.isfinite(m.thrust):
        return "attitude setpoint without thrust"
    if m.thrust < 0.0:
        return "negative thrust"  # PX4 v1.16 flies its absolute value
    if not all(abs(x) <= _MAX_ABS for x in (roll, pitch, yaw)):
        return "body rate is not finite"
    thrust = min(m.thrust, 1.0)
    if not by_attitude:
        v.offboard.set_rates(v.row, (roll, pitch, yaw), thrust, v.now)
        return None
    q = tuple(m.q)
    norm = math.sqrt(sum(x * x for x in q))
    if not math.isfinite(norm) or norm < _MIN_QUAT_NORM:
        return "attitude is not a quaternion"
    q_nb = (q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm)
    v.offboard.set_attitude(v.row, q_nb, yaw, thrust, v.now)
    return None
