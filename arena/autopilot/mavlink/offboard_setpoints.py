"""Offboard setpoints off the wire: type masks and frames as PX4 reads them, and which values it refuses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.control.setpoints import Level

Triple = tuple[float, float, float]
_NAN = math.nan
_NOTHING: Triple = (_NAN, _NAN, _NAN)
_TILTING = (
    mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    | mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
)
_SHORTEST = 1e-3  # of a quaternion: below this there is no direction in it
_MOST = 1e6  # m, m/s, m/s2, rad, rad/s: what is larger is no setpoint but a mistake


@dataclass(frozen=True, slots=True, kw_only=True)
class Offboard:
    """One setpoint.

    p_n, v_n, a_n [NED], NaN where not given; yaw [rad]; yaw_rate [rad/s]; q_nb wxyz; omega_b [rad/s] [FRD]; thrust 0..1.
    """

    level: Level
    p_n: Triple = (_NAN, _NAN, _NAN)
    v_n: Triple = (_NAN, _NAN, _NAN)
    a_n: Triple = (_NAN, _NAN, _NAN)
    yaw: float = _NAN
    yaw_rate: float = _NAN
    q_nb: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    omega_b: Triple = (0.0, 0.0, 0.0)
    thrust: float = 0.0

    @property
    def needs_position(self) -> bool:
        """Position or velocity is asked for, so the estimate of it must be valid."""
        return self.level is Level.POSITION and any(math.isfinite(x) for x in (*self.p_n, *self.v_n))


def from_position_target(m: Any, q_nb: list[float]) -> Offboard | str:
    """SET_POSITION_TARGET_LOCAL_NED -> a setpoint, or why it is refused. q_nb: attitude now, for body axes.

    In body axes a velocity turns with the heading alone, an acceleration with the whole attitude, a position is passed over, and
    one ignored axis ignores its three.
    """
    mask = m.type_mask
    p, v, a = (
        _given((m.x, m.y, m.z), mask, 0),
        _given((m.vx, m.vy, m.vz), mask, 3),
        _given((m.afx, m.afy, m.afz), mask, 6),
    )
    if m.coordinate_frame == mavlink.MAV_FRAME_BODY_NED:
        v, a = _NOTHING if _any_ignored(mask, 3) else v, _NOTHING if _any_ignored(mask, 6) else a
        p, v, a = _NOTHING, _turn_by_yaw(q_nb, v), _turn(q_nb, a)
    elif m.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        return f"coordinate frame {m.coordinate_frame} is not supported"
    return _cascade(m, p, v, a)


def from_global_target(
    m: Any, local: Callable[[float, float, float], Triple | None], home_down: float | None
) -> Offboard | str:
    """SET_POSITION_TARGET_GLOBAL_INT -> a setpoint, or why it is refused. An empty reason: passed over in silence, as PX4 does.

    local: latitude, longitude [deg], altitude [m] -> p_n [m], None without an origin. home_down: home's height [m] [NED].
    """
    mask, frame = m.type_mask, m.coordinate_frame
    p = _NOTHING
    if not _any_ignored(mask, 0):
        found = local(m.lat_int * 1e-7, m.lon_int * 1e-7, m.alt)
        if found is None or frame == mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT:
            return ""
        if frame == mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT:
            if home_down is None:
                return ""
            found = (found[0], found[1], home_down - m.alt)
        elif frame != mavlink.MAV_FRAME_GLOBAL_INT:
            return f"coordinate frame {frame} is not supported"
        p = found
    return _cascade(m, p, _given((m.vx, m.vy, m.vz), mask, 3), _given((m.afx, m.afy, m.afz), mask, 6))


def _cascade(m: Any, p: Triple, v: Triple, a: Triple) -> Offboard | str:
    mask = m.type_mask
    yaw = _NAN if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE else m.yaw
    yaw_rate = _NAN if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE else m.yaw_rate
    if any(abs(x) > _MOST for x in (*p, *v, *a, yaw, yaw_rate)):  # PX4 refuses the infinite alone
        return "infinite value in setpoint"
    if mask & mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET and _any_finite(a):
        return "force setpoints are not supported"
    if not _any_finite((*p, *v, *a)):
        return "setpoint without position, velocity or acceleration"
    if not _complete(p, v, a):
        # PX4's cascade does not fly what leaves an axis free, or gives one horizontal axis without the other: it stops and holds.
        return Offboard(level=Level.POSITION, v_n=(0.0, 0.0, 0.0))
    return Offboard(level=Level.POSITION, p_n=p, v_n=v, a_n=a, yaw=yaw, yaw_rate=yaw_rate)


def _complete(p: Triple, v: Triple, a: Triple) -> bool:
    each = all(_any_finite(axis) for axis in zip(p, v, a, strict=True))
    return each and all(math.isfinite(x[0]) == math.isfinite(x[1]) for x in (p, v, a))


def from_attitude_target(m: Any) -> Offboard | str:
    """SET_ATTITUDE_TARGET -> a setpoint, or why it is refused; an empty reason: it asks for nothing. Attitude outranks rates."""
    mask = m.type_mask
    by_attitude = not mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    if not by_attitude and mask & _TILTING:
        return ""
    rates = tuple(
        0.0 if mask & (1 << i) else x
        for i, x in enumerate((m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate))
    )
    if mask & mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE or not math.isfinite(m.thrust):
        return "attitude setpoint without thrust"
    if m.thrust < 0.0:
        return "thrust below nought"  # PX4 v1.16 flies its absolute value
    if not all(abs(x) <= _MOST for x in rates):
        return "body rate that is not finite"
    thrust = min(m.thrust, 1.0)
    if not by_attitude:
        return Offboard(level=Level.RATE, omega_b=rates, thrust=thrust)  # type: ignore[arg-type]
    q = tuple(m.q)
    norm = math.sqrt(sum(x * x for x in q))
    if not math.isfinite(norm) or norm < _SHORTEST:
        return "attitude that is no rotation"
    q_nb = (q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm)
    return Offboard(level=Level.ATTITUDE, q_nb=q_nb, yaw_rate=rates[2], thrust=thrust)


def _any_ignored(mask: int, shift: int) -> bool:
    return bool(mask >> shift & 0b111)


def _any_finite(values: tuple[float, ...]) -> bool:
    return any(math.isfinite(x) for x in values)


def _given(values: Triple, mask: int, shift: int) -> Triple:
    ignored = mask >> shift & 0b111
    if not ignored:
        return values
    x, y, z = (_NAN if ignored >> i & 1 else value for i, value in enumerate(values))
    return x, y, z


def _turn_by_yaw(q: list[float], v: Triple) -> Triple:
    yaw = math.atan2(2 * (q[0] * q[3] + q[1] * q[2]), 1 - 2 * (q[2] * q[2] + q[3] * q[3]))
    if any(math.isnan(x) for x in v[:2]):
        return _NAN, _NAN, v[2]
    c, s = math.cos(yaw), math.sin(yaw)
    return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]


def _turn(q: list[float], v: Triple) -> Triple:
    if any(math.isnan(x) for x in v):
        return _NAN, _NAN, _NAN
    w, x, y, z = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return v[0] + w * tx + y * tz - z * ty, v[1] + w * ty + z * tx - x * tz, v[2] + w * tz + x * ty - y * tx
