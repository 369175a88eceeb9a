"""Decoding of offboard setpoint messages, with PX4's rules for type masks, frames and refusals.

Each function returns an `OffboardSetpoint`, or a text with the reason of the refusal. The text "" means that
the refusal is not reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.control.setpoints import Level, OffboardSetpoint, Triple

_NAN = math.nan
_NOT_GIVEN: Triple = (_NAN, _NAN, _NAN)
_ROLL_PITCH_RATE_IGNORED = (
    mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    | mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
)
_MIN_QUAT_NORM = 1e-3
_MAX_ABS = 1e6  # [m], [m/s], [m/s2], [rad], [rad/s]: a larger value is a mistake


def from_position_target(m: Any, q_nb: list[float]) -> OffboardSetpoint | str:
    """Decode SET_POSITION_TARGET_LOCAL_NED.

    In body frames a velocity is rotated by the heading alone, an acceleration by the whole attitude, and a
    position is ignored. If one axis of a body-frame vector is ignored, all three are.

    q_nb: present attitude [-] wxyz
    """
    mask = m.type_mask
    p, v, a = (
        _given((m.x, m.y, m.z), mask, 0),
        _given((m.vx, m.vy, m.vz), mask, 3),
        _given((m.afx, m.afy, m.afz), mask, 6),
    )
    if m.coordinate_frame == mavlink.MAV_FRAME_BODY_NED:
        v, a = _NOT_GIVEN if _any_ignored(mask, 3) else v, _NOT_GIVEN if _any_ignored(mask, 6) else a
        p, v, a = _NOT_GIVEN, _rotate_by_yaw(q_nb, v), _rotate(q_nb, a)
    elif m.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        return f"coordinate frame {m.coordinate_frame} is not supported"
    return _position_setpoint(m, p, v, a)


def from_global_target(
    m: Any,
    local: Callable[[float, float, float], Triple | None],
    home_d: float | None,
    heading: float = 0.0,
) -> OffboardSetpoint | str:
    """Decode SET_POSITION_TARGET_GLOBAL_INT.

    local: converts latitude, longitude [deg], altitude AMSL [m] to p_n [m] [NED]; returns None without an
        origin
    home_d: height of home [m] [NED down], None if home is not set
    heading: direction of the local frame's north, clockwise from true north [rad]. Velocity, acceleration and
        yaw of the message count from true north.
    """
    mask, frame = m.type_mask, m.coordinate_frame
    p = _NOT_GIVEN
    if not _any_ignored(mask, 0):
        found = local(m.lat_int * 1e-7, m.lon_int * 1e-7, m.alt)
        if found is None or frame == mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT:
            return ""
        if frame == mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT:
            if home_d is None:
                return ""
            found = (found[0], found[1], home_d - m.alt)
        elif frame != mavlink.MAV_FRAME_GLOBAL_INT:
            return f"coordinate frame {frame} is not supported"
        p = found
    v, a = _given((m.vx, m.vy, m.vz), mask, 3), _given((m.afx, m.afy, m.afz), mask, 6)
    if heading:
        v, a = _turn(v, -heading), _turn(a, -heading)
    return _position_setpoint(m, p, v, a, heading)


def _position_setpoint(
    m: Any, p: Triple, v: Triple, a: Triple, heading: float = 0.0
) -> OffboardSetpoint | str:
    mask = m.type_mask
    yaw = _NAN if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE else m.yaw - heading
    yaw_rate = _NAN if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE else m.yaw_rate
    for x in (*p, *v, *a, yaw, yaw_rate):
        if abs(x) > _MAX_ABS:  # PX4 refuses infinite values only
            return "infinite value in setpoint"
    if mask & mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET and _any_finite(a):
        return "force setpoints are not supported"
    if not _any_finite((*p, *v, *a)):
        return "setpoint without position, velocity or acceleration"
    if not _complete(p, v, a):
        # PX4 stops and holds if an axis has no setpoint, or one horizontal axis has one and the other has
        # not.
        return OffboardSetpoint(level=Level.POSITION, v_n=(0.0, 0.0, 0.0))
    return OffboardSetpoint(level=Level.POSITION, p_n=p, v_n=v, a_n=a, yaw=yaw, yaw_rate=yaw_rate)


def _complete(p: Triple, v: Triple, a: Triple) -> bool:
    has_p, has_v, has_a = _finite(p), _finite(v), _finite(a)
    every_axis = all(map(any, zip(has_p, has_v, has_a, strict=True)))
    return every_axis and has_p[0] == has_p[1] and has_v[0] == has_v[1] and has_a[0] == has_a[1]


def from_attitude_target(m: Any) -> OffboardSetpoint | str:
    """Decode SET_ATTITUDE_TARGET. If the message has an attitude, its body rates are ignored."""
    mask = m.type_mask
    by_attitude = not mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    if not by_attitude and mask & _ROLL_PITCH_RATE_IGNORED:
        return ""
    rates = tuple(
        0.0 if mask & (1 << i) else x
        for i, x in enumerate((m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate))
    )
    if mask & mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE or not math.isfinite(m.thrust):
        return "attitude setpoint without thrust"
    if m.thrust < 0.0:
        return "negative thrust"  # PX4 v1.16 flies its absolute value
    if not all(abs(x) <= _MAX_ABS for x in rates):
        return "body rate is not finite"
    thrust = min(m.thrust, 1.0)
    if not by_attitude:
        return OffboardSetpoint(level=Level.RATE, omega_b=rates, thrust=thrust)  # type: ignore[arg-type]
    q = tuple(m.q)
    norm = math.sqrt(sum(x * x for x in q))
    if not math.isfinite(norm) or norm < _MIN_QUAT_NORM:
        return "attitude is not a quaternion"
    q_nb = (q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm)
    return OffboardSetpoint(level=Level.ATTITUDE, q_nb=q_nb, yaw_rate=rates[2], thrust=thrust)


def _any_ignored(mask: int, shift: int) -> bool:
    return bool(mask >> shift & 0b111)


def _any_finite(values: tuple[float, ...]) -> bool:
    return any(map(math.isfinite, values))


def _finite(values: Triple) -> list[bool]:
    return list(map(math.isfinite, values))


def _given(values: Triple, mask: int, shift: int) -> Triple:
    ignored = mask >> shift & 0b111
    if not ignored:
        return values
    if ignored == 0b111:
        return _NOT_GIVEN
    x, y, z = values
    return _NAN if ignored & 1 else x, _NAN if ignored & 2 else y, _NAN if ignored & 4 else z


def _rotate_by_yaw(q: list[float], v: Triple) -> Triple:
    return _turn(v, math.atan2(2 * (q[0] * q[3] + q[1] * q[2]), 1 - 2 * (q[2] * q[2] + q[3] * q[3])))


def _turn(v: Triple, angle: float) -> Triple:
    """Rotate a vector about the down axis by an angle [rad].

    NaN in one horizontal axis makes both NaN.
    """
    if any(math.isnan(x) for x in v[:2]):
        return _NAN, _NAN, v[2]
    c, s = math.cos(angle), math.sin(angle)
    return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]


def _rotate(q: list[float], v: Triple) -> Triple:
    if any(math.isnan(x) for x in v):
        return _NAN, _NAN, _NAN
    w, x, y, z = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return v[0] + w * tx + y * tz - z * ty, v[1] + w * ty + z * tx - x * tz, v[2] + w * tz + x * ty - y * tx
