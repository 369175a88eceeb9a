"""Offboard setpoints off the wire: type masks and frames as PX4 reads them, and which values it refuses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.setpoint import Level

Triple = tuple[float, float, float]
_NAN = math.nan
_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)


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
    """SET_POSITION_TARGET_LOCAL_NED -> a setpoint, or why it is refused. q_nb: attitude now, for body frames."""
    mask = m.type_mask
    if mask & mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET:
        return "force setpoints are not supported"
    p = _given((m.x, m.y, m.z), mask, 0)
    v = _given((m.vx, m.vy, m.vz), mask, 3)
    a = _given((m.afx, m.afy, m.afz), mask, 6)
    yaw = _NAN if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE else m.yaw
    yaw_rate = _NAN if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE else m.yaw_rate
    if any(math.isinf(x) for x in (*p, *v, *a, yaw, yaw_rate)):
        return "infinite value in setpoint"
    if m.coordinate_frame in _BODY_FRAMES:
        p, v, a = (_NAN, _NAN, _NAN), _turn_by_yaw(q_nb, v), _turn(q_nb, a)
    elif m.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        return f"coordinate frame {m.coordinate_frame} is not supported"
    if not any(math.isfinite(x) for x in (*p, *v, *a)):
        return "setpoint without position, velocity or acceleration"
    return Offboard(level=Level.POSITION, p_n=p, v_n=v, a_n=a, yaw=yaw, yaw_rate=yaw_rate)


def from_attitude_target(m: Any) -> Offboard | str:
    """SET_ATTITUDE_TARGET -> a setpoint, or why it is refused."""
    mask = m.type_mask
    rates = tuple(0.0 if mask & (1 << i) else x for i, x in enumerate((m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)))
    by_attitude = not mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    if mask & mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE or not math.isfinite(m.thrust):
        return "attitude setpoint without thrust"
    if not all(math.isfinite(x) for x in rates):
        return "body rate that is not finite"
    thrust = min(max(m.thrust, 0.0), 1.0)
    if not by_attitude:
        return Offboard(level=Level.RATE, omega_b=rates, thrust=thrust)  # type: ignore[arg-type]
    q = tuple(m.q)
    norm = math.sqrt(sum(x * x for x in q))
    if not math.isfinite(norm) or norm < 0.5 or norm > 2.0:
        return "attitude that is no rotation"
    yaw_rate = rates[2] if not mask & mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE else 0.0
    q_nb = (q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm)
    return Offboard(level=Level.ATTITUDE, q_nb=q_nb, yaw_rate=yaw_rate, thrust=thrust)


def _given(values: Triple, mask: int, shift: int) -> Triple:
    x, y, z = (_NAN if mask >> (shift + i) & 1 else value for i, value in enumerate(values))
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
