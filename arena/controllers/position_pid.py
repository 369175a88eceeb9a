"""Position controller (PID with feed-forward) that computes an attitude and a thrust.

    a = a_ref + k_p (p_ref - p) + k_d (v_ref - v) + k_i integral(p_ref - p) dt
    f = m (a - g),  g = (0, 0, 9.80665) m/s2

The vehicle pushes against its body z axis, so z_b = -f / |f| and the thrust is |f|; the yaw decides the rest of the attitude.
D. Mellinger and V. Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011, equations 6 and 10 to 12
(theirs are for z up; these are for NED). The integral is an addition.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from arena.constants import GRAVITY_M_S2
from arena.geometry import Array, quat_from_matrix
from arena.portable_math import norm
from arena.trajectories.trajectory import Reference


@dataclass(frozen=True, kw_only=True)
class Gains:
    """Gains of the position controller for north, east, down (3,).

    p: [1/s2].  d: [1/s].  i: [1/s3].
    """

    p: tuple[float, float, float] = (4.0, 4.0, 5.0)
    d: tuple[float, float, float] = (3.2, 3.2, 3.6)
    i: tuple[float, float, float] = (0.4, 0.4, 0.6)


@dataclass(frozen=True, kw_only=True)
class AttitudeThrust:
    """Attitude and thrust, as setpoint for `UAV.set_att_thrust`.

    q_nb: attitude wxyz [-] (4,). thrust_n: [N]. tilt: angle from the vertical [rad].
    """

    q_nb: Array
    thrust_n: float
    tilt: float


class PositionPid:
    """Position controller (PID) with feed-forward of the wanted velocity and acceleration.

    mass_kg: mass of the vehicle [kg].
    max_tilt: largest tilt [rad].  max_thrust_n: largest thrust [N]; None: no limit.
    max_integral_m_s2: largest contribution of the integral on each axis [m/s2].

    While the tilt or the thrust is limited, the integral does not grow (anti-windup).
    """

    def __init__(
        self,
        mass_kg: float,
        gains: Gains | None = None,
        *,
        max_tilt: float = math.radians(40.0),
        max_thrust_n: float | None = None,
        max_integral_m_s2: float = 2.0,
    ) -> None:
        gains = Gains() if gains is None else gains
        self._mass, self._max_tilt, self._max_thrust = mass_kg, max_tilt, max_thrust_n
        self._p, self._d, self._i = (np.array(k, float) for k in (gains.p, gains.d, gains.i))
        self._most = max_integral_m_s2
        self._integral: Array = np.zeros(3)
        self._before: float | None = None

    @property
    def integral(self) -> Array:
        """Acceleration that the integral part commands [m/s2] [NED] (3,)."""
        return self._integral.copy()

    def reset(self) -> None:
        """Set the integral to zero, for example before a new flight."""
        self._integral, self._before = np.zeros(3), None

    def update(self, reference: Reference, pos: ArrayLike, vel: ArrayLike, now: float) -> AttitudeThrust:
        """Return the attitude and thrust setpoint for one control step.

        reference: where the vehicle should be.  pos: position [m] [NED] (3,).  vel: velocity [m/s] [NED] (3,).
        now: time [s], of any clock that does not jump. The first call does not integrate, and a step counts 0.1 s at most.
        """
        error = reference.pos - np.asarray(pos, float)
        step_s = 0.0 if self._before is None else min(max(now - self._before, 0.0), 0.1)
        self._before = now
        integral = np.clip(self._integral + self._i * error * step_s, -self._most, self._most)
        wanted = reference.acc + self._p * error + self._d * (reference.vel - np.asarray(vel, float))
        found, limited = self._limited(wanted + integral, reference.yaw)
        if not limited:
            self._integral = integral
        return found

    def _limited(self, acc: Array, yaw: float) -> tuple[AttitudeThrust, bool]:
        """Return the attitude and thrust for a wanted acceleration, and whether tilt or thrust was limited.

        acc: [m/s2] [NED] (3,)
        """
        force = self._mass * (acc - np.array([0.0, 0.0, GRAVITY_M_S2]))
        up = max(
            -float(force[2]), 1e-3 * self._mass * GRAVITY_M_S2
        )  # a thrust below zero would turn the vehicle over
        limited = up != -force[2]
        side, most = float(np.hypot(force[0], force[1])), up * math.tan(self._max_tilt)
        if side > most:
            force[:2] *= most / side
            limited = True
        force[2] = -up
        size = norm(force)
        if self._max_thrust is not None and size > self._max_thrust:
            force *= self._max_thrust / size
            limited = True
        return attitude_thrust(force, yaw), limited


def attitude_thrust(force: ArrayLike, yaw: float) -> AttitudeThrust:
    """Return the attitude and the thrust that produce a force on the vehicle.

    force: force of the rotors [N] [NED] (3,), not zero.  yaw: heading of the nose [rad].
    """
    f = np.asarray(force, float)
    size = norm(f)
    z_b = -f / size
    ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    y_b = np.cross(z_b, ahead)
    y_b /= norm(y_b)
    r_nb = np.column_stack([np.cross(y_b, z_b), y_b, z_b])
    return AttitudeThrust(
        q_nb=quat_from_matrix(r_nb), thrust_n=size, tilt=math.acos(min(1.0, max(-1.0, float(z_b[2]))))
    )
