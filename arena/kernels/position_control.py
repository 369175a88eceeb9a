"""Position and velocity controller: computes attitude and collective thrust from position setpoints.

Structure and parameter names are PX4's: position P, velocity PID, acceleration, thrust vector, attitude.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.constants import GRAVITY_M_S2
from arena.kernels import limits, rotations
from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats
    from arena.kernels.rotations import Quaternion

_NAN = float("nan")
_G = GRAVITY_M_S2


class PositionLaw:
    """Position and velocity controller of V vehicles.

    Arrays with three columns are NED.

    dt: time step [s]
    p, vp, vi_dt, vd: gains of position [1/s] and velocity [1/s], [1/s2 * s], [-]; `vi_dt` contains the time step (V, 3)
    hover, thr_min, thr_max, margin: MPC_THR_HOVER, MPC_THR_MIN, MPC_THR_MAX, MPC_THR_XY_MARG [-] (V,)
    xy_max, up_max, down_max: limits of the speed [m/s] (V,)
    tilt_air: MPC_TILTMAX_AIR [rad] (V,)
    low_pass: coefficient of the filter of the acceleration for one step 0..1 (V,)
    speed_up, tilt_max: limits of climb rate [m/s] and tilt [rad], set by the take-off ramp (V,)
    p_n, v_n, q_nb: input: position [m], velocity [m/s] (V, 3) and attitude wxyz (V, 4)
    sp_p_n, sp_v_n, sp_a_n, sp_yaw: input: setpoints of position [m], velocity [m/s], acceleration [m/s2] (V, 3) and
        heading [rad] (V,), NaN where not given
    integral: integral of the velocity error [m/s2] (V, 3)
    v_last, v_dot: velocity of the last step [m/s] and filtered acceleration [m/s2] (V, 3)
    v_sp_n, a_sp_n: output: velocity [m/s] and acceleration [m/s2] setpoint (V, 3)
    thrust_n: output: normalised thrust vector [-] (V, 3)
    thrust: output: collective thrust 0..1 (V,)
    q_sp: output: attitude setpoint wxyz (V, 4)
    """

    def __init__(self, vehicles: int, dt: float) -> None:
        v, self.dt = vehicles, dt
        self.p, self.vp, self.vi_dt, self.vd = floats(v, 3), floats(v, 3), floats(v, 3), floats(v, 3)
        self.hover, self.thr_min, self.thr_max, self.margin = floats(v), floats(v), floats(v), floats(v)
        self.xy_max, self.up_max, self.down_max = floats(v), floats(v), floats(v)
        self.tilt_air, self.low_pass = floats(v), floats(v)
        self.speed_up, self.tilt_max = floats(v, fill=float("inf")), floats(v, fill=float("inf"))
        self.p_n, self.v_n, self.q_nb = floats(v, 3), floats(v, 3), floats(v, 4)
        self.sp_p_n, self.sp_v_n, self.sp_a_n, self.sp_yaw = (
            floats(v, 3),
            floats(v, 3),
            floats(v, 3),
            floats(v),
        )
        self.integral, self.v_last, self.v_dot = floats(v, 3), floats(v, 3), floats(v, 3)
        self.v_sp_n, self.a_sp_n = floats(v, 3, fill=_NAN), floats(v, 3, fill=_NAN)
        self.thrust_n, self.thrust, self.q_sp = floats(v, 3), floats(v), floats(v, 4)
        self._error = floats(3)

    def read_setpoints_from(self, p_n: Floats, v_n: Floats, a_n: Floats, yaw: Floats) -> None:
        """Store the arrays from which `step` reads setpoints of position, velocity, acceleration and heading."""
        self.sp_p_n, self.sp_v_n, self.sp_a_n, self.sp_yaw = p_n, v_n, a_n, yaw

    def step(self) -> None:
        """Run the controller of all vehicles for one time step."""
        for i in range(len(self.thrust)):
            self._set_velocity(i)
            for axis in range(3):
                self._set_acceleration(i, axis)
            wanted_z = self._set_thrust(i)
            self._integrate(i, wanted_z)
            x, y, z = self.thrust_n[i, 0], self.thrust_n[i, 1], self.thrust_n[i, 2]
            self.thrust[i] = math.sqrt(x * x + y * y + z * z)
            yaw, q = self.sp_yaw[i], self.q_nb
            if not math.isfinite(yaw):
                yaw = rotations.yaw((q[i, 0], q[i, 1], q[i, 2], q[i, 3]))
            self.q_sp[i, 0], self.q_sp[i, 1], self.q_sp[i, 2], self.q_sp[i, 3] = attitude_from_thrust(
                x, y, z, yaw
            )

    def _set_velocity(self, i: int) -> None:
        """Compute the velocity setpoint of vehicle i.

        The part from the position error has priority over the feed-forward.
        """
        n, e, d = self._from_position(i, 0), self._from_position(i, 1), self._from_position(i, 2)
        feed_n, feed_e, feed_d = self._feed_forward(i, 0), self._feed_forward(i, 1), self._feed_forward(i, 2)
        n, e = limits.sum_within(n, e, feed_n, feed_e, self.xy_max[i])
        d = max(min(d + feed_d, self.down_max[i]), -min(self.up_max[i], self.speed_up[i]))
        self.v_sp_n[i, 0] = n if self._is_controlled(i, 0) else _NAN
        self.v_sp_n[i, 1] = e if self._is_controlled(i, 1) else _NAN
        self.v_sp_n[i, 2] = d if self._is_controlled(i, 2) else _NAN

    def _from_position(self, i: int, axis: int) -> float:
        """Return the velocity that corrects the position error [m/s]; 0 without a position setpoint."""
        wanted = (self.sp_p_n[i, axis] - self.p_n[i, axis]) * self.p[i, axis]
        return wanted if math.isfinite(wanted) else 0.0

    def _feed_forward(self, i: int, axis: int) -> float:
        """Return the commanded velocity setpoint of an axis [m/s]; 0 without one."""
        return self.sp_v_n[i, axis] if math.isfinite(self.sp_v_n[i, axis]) else 0.0

    def _is_controlled(self, i: int, axis: int) -> bool:
        """Return whether an axis of vehicle i has a position or velocity setpoint."""
        return math.isfinite(self.sp_p_n[i, axis] - self.p_n[i, axis]) or math.isfinite(self.sp_v_n[i, axis])

    def _set_acceleration(self, i: int, axis: int) -> None:
        """Compute the acceleration setpoint of one axis of vehicle i by PID and feed-forward."""
        v, given = self.v_n[i, axis], self.sp_a_n[i, axis]
        self.v_dot[i, axis] += self.low_pass[i] * ((v - self.v_last[i, axis]) / self.dt - self.v_dot[i, axis])
        self.v_last[i, axis] = v
        accel, self._error[axis] = self.integral[i, axis], 0.0
        if math.isfinite(self.v_sp_n[i, axis]):
            self._error[axis] = self.v_sp_n[i, axis] - v
            accel += self._error[axis] * self.vp[i, axis] - self.v_dot[i, axis] * self.vd[i, axis]
        self.a_sp_n[i, axis] = accel + (given if math.isfinite(given) else 0.0)

    def _set_thrust(self, i: int) -> float:
        """Compute the thrust vector of vehicle i. Return the vertical thrust before the limit MPC_THR_MAX [-] [NED].

        The tilt is limited first. Vertical thrust has priority over horizontal thrust, except for a margin of
        MPC_THR_XY_MARG for horizontal thrust.
        """
        x, y, z = -self.a_sp_n[i, 0], -self.a_sp_n[i, 1], _G
        size = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / size, y / size, z / size  # axis of the thrust, down
        limit = min(self.tilt_air[i], self.tilt_max[i])
        if z < math.cos(limit):
            share = math.sin(limit) / max(limits.length(x, y), 1e-9)
            x, y, z = x * share, y * share, math.cos(limit)
        along_z = self.a_sp_n[i, 2] * self.hover[i] / _G - self.hover[i]
        collective = min(along_z / z, -self.thr_min[i])
        x, y, wanted_z = x * collective, y * collective, z * collective
        horizontal, most = min(limits.length(x, y), self.margin[i]), self.thr_max[i] * self.thr_max[i]
        z = max(wanted_z, -math.sqrt(max(most - horizontal * horizontal, 0.0)))
        x, y = limits.shortened(x, y, math.sqrt(max(most - z * z, 0.0)))
        self.thrust_n[i, 0], self.thrust_n[i, 1], self.thrust_n[i, 2] = x, y, z
        return wanted_z

    def _integrate(self, i: int, wanted_z: float) -> None:
        """Integrate the velocity error of vehicle i, with anti-windup.

        The vertical integral is frozen while the requested thrust saturates. The limit keeps a margin for
        horizontal thrust, so the limited thrust is smaller than MPC_THR_MAX and does not show the saturation.
        The horizontal integral tracks the thrust that was produced.

        wanted_z: vertical thrust before the limit [-] [NED]
        """
        n, e, d = self._error[0], self._error[1], self._error[2]
        if (wanted_z >= -self.thr_min[i] and d >= 0.0) or (wanted_z <= -self.thr_max[i] and d <= 0.0):
            d = 0.0
        wanted_n, wanted_e = self.a_sp_n[i, 0], self.a_sp_n[i, 1]
        made_n, made_e = self.thrust_n[i, 0] * _G / self.hover[i], self.thrust_n[i, 1] * _G / self.hover[i]
        if limits.length(wanted_n, wanted_e) > limits.length(made_n, made_e):
            n -= 2.0 / self.vp[i, 0] * (wanted_n - made_n)
            e -= 2.0 / self.vp[i, 0] * (wanted_e - made_e)
        # PX4 limits the vertical integral only. An absurd acceleration would wind up the horizontal one for
        # the rest of the flight.
        self.integral[i, 0] = limits.within(self.integral[i, 0] + n * self.vi_dt[i, 0], -_G, _G)
        self.integral[i, 1] = limits.within(self.integral[i, 1] + e * self.vi_dt[i, 1], -_G, _G)
        self.integral[i, 2] = limits.within(self.integral[i, 2] + d * self.vi_dt[i, 2], -_G, _G)


def attitude_from_thrust(north: float, east: float, down: float, yaw: float) -> Quaternion:
    """Return the attitude wxyz, w >= 0, whose body z axis is opposite to the thrust.

    north, east, down: thrust vector [-]
    yaw: heading of the attitude [rad]
    """
    x, y, z = -north, -east, -down
    cos, sin = math.cos(yaw), math.sin(yaw)
    ahead, aside = cos * x + sin * y, cos * y - sin * x
    up = -1.0 if z < 0.0 else 1.0
    w, i, j, k = rotations.from_euler(
        math.atan2(-aside, up * limits.length(ahead, z)), math.atan2(up * ahead, abs(z)), yaw
    )
    return (-w, -i, -j, -k) if w < 0.0 else (w, i, j, k)
