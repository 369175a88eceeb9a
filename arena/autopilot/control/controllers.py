"""Cascaded controllers from position to torques, batched over vehicles.

Structure and parameter names are PX4's:

    position P -> velocity PID -> acceleration -> thrust vector and attitude -> attitude P on the quaternion
    -> rate PID

Attitude law: Brescianini, Hehn, D'Andrea, "Nonlinear quadrocopter attitude control", ETH, 2013. It corrects
the tilt first and weights yaw less.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.param_table import Params
from arena.constants import GRAVITY_M_S2
from arena.geometry import quat_between, quat_from_euler, yaw_from_quat

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]

_INTEGRAL_CUTOFF = 1.0 / np.radians(400.0)  # a larger rate error is a transient and is not integrated [s/rad]
_POSITION_PERIOD_S = 0.008  # of the position loop


class PositionControl:
    """Position and velocity controller of V vehicles: computes attitude and collective thrust from setpoints.

    thrust_n: normalised thrust vector [-] [NED] (V, 3)
    v_sp_n, a_sp_n: velocity [m/s] and acceleration [m/s2] setpoint [NED] (V, 3)
    speed_up: limit of the climb rate, set by the take-off ramp [m/s] (V,)
    tilt_max: limit of the tilt, set by the take-off ramp [rad] (V,)
    """

    def __init__(self, params: Params, vehicles: int, dt: float) -> None:
        self.params, self.dt = params, dt
        self.integral = np.zeros((vehicles, 3))
        self.thrust_n = np.zeros((vehicles, 3))
        self.v_sp_n = np.full((vehicles, 3), np.nan)
        self.a_sp_n = np.full((vehicles, 3), np.nan)
        self.speed_up = np.full(vehicles, np.inf)
        self.tilt_max = np.full(vehicles, np.inf)
        self._v_last, self._v_dot = np.zeros((vehicles, 3)), np.zeros((vehicles, 3))
        self._read_params()

    def _read_params(self) -> None:
        p = self.params
        self._version = p.version
        self._p = p.columns("MPC_XY_P", "MPC_XY_P", "MPC_Z_P")
        self._vp = p.columns("MPC_XY_VEL_P_ACC", "MPC_XY_VEL_P_ACC", "MPC_Z_VEL_P_ACC")
        self._vi = p.columns("MPC_XY_VEL_I_ACC", "MPC_XY_VEL_I_ACC", "MPC_Z_VEL_I_ACC")
        self._vd = p.columns("MPC_XY_VEL_D_ACC", "MPC_XY_VEL_D_ACC", "MPC_Z_VEL_D_ACC")
        self._hover, self._thr_min, self._thr_max = p["MPC_THR_HOVER"], p["MPC_THR_MIN"], p["MPC_THR_MAX"]
        self._per_thrust, self._short_gain = GRAVITY_M_S2 / self._hover, 2.0 / self._vp[:, 0]
        self._vi_dt = self._vi * self.dt
        self._margin, self._xy_max = p["MPC_THR_XY_MARG"], p["MPC_XY_VEL_MAX"]
        self._up_max, self._down_max = p["MPC_Z_VEL_MAX_UP"], p["MPC_Z_VEL_MAX_DN"]
        self._tilt_air = np.radians(p["MPC_TILTMAX_AIR"])
        cutoff = p["MPC_VELD_LP"]
        self._lp = (self.dt / (self.dt + 1.0 / (2 * np.pi * np.maximum(cutoff, 1e-3))))[:, None]

    def reset(self, which: Bool | int) -> None:
        """Clear the velocity integral and the filtered acceleration of the selected vehicles."""
        self.integral[which] = 0.0
        self._v_dot[which] = 0.0

    def update(self, sp: Setpoints, est: Estimator) -> tuple[Array, Array]:
        """Run the position and velocity controller. Return the attitude setpoint [-] wxyz (V, 4) and collective thrust 0..1 (V,).

        sp: setpoints; those at position level are used
        est: estimator of all vehicles
        """
        if self._version != self.params.version:
            self._read_params()
        self._v_dot += self._lp * ((est.v_n - self._v_last) / self.dt - self._v_dot)
        self._v_last = est.v_n.copy()
        v_sp = self._velocity_setpoint(sp, est)
        held = np.isfinite(v_sp)
        error = np.where(held, v_sp - est.v_n, 0.0)
        a_sp = error * self._vp + self.integral - self._v_dot * self._vd * held
        a_sp += np.where(np.isfinite(sp.a_n), sp.a_n, 0.0)
        self._integrate(error, a_sp, self._to_thrust(a_sp))
        self.v_sp_n, self.a_sp_n = v_sp, a_sp
        yaw = np.where(np.isfinite(sp.yaw), sp.yaw, yaw_from_quat(est.q_nb))
        return attitude_from_thrust(self.thrust_n, yaw), _length(self.thrust_n)

    def _velocity_setpoint(self, sp: Setpoints, est: Estimator) -> Array:
        wanted = (sp.p_n - est.p_n) * self._p
        has_p, has_v = np.isfinite(wanted), np.isfinite(sp.v_n)
        from_p, feed = np.where(has_p, wanted, 0.0), np.where(has_v, sp.v_n, 0.0)
        v = from_p + feed
        over = v[:, 0] ** 2 + v[:, 1] ** 2 > self._xy_max**2
        if over.any():
            limited = _add_within(from_p[:, :2], feed[:, :2], self._xy_max)
            v[:, :2] = np.where(over[:, None], limited, v[:, :2])
        v[:, 2] = np.maximum(np.minimum(v[:, 2], self._down_max), -np.minimum(self._up_max, self.speed_up))
        return np.where(has_p | has_v, v, np.nan)

    def _to_thrust(self, a_sp: Array) -> Array:
        """Compute the thrust vector from an acceleration setpoint. Return its vertical part before the limit [-] (V,).

        The tilt is limited first. Vertical thrust has priority over horizontal thrust, except for a margin of
        MPC_THR_XY_MARG for horizontal thrust.
        """
        body_z = -a_sp
        body_z[:, 2] = GRAVITY_M_S2
        body_z /= _length(body_z)[:, None]
        limit = np.minimum(self._tilt_air, self.tilt_max)
        over = body_z[:, 2] < np.cos(limit)
        if over.any():
            flat = body_z[:, :2] / np.maximum(np.hypot(body_z[:, 0], body_z[:, 1]), 1e-9)[:, None]
            body_z[over] = np.concatenate([flat * np.sin(limit)[:, None], np.cos(limit)[:, None]], axis=1)[
                over
            ]
        along_z = a_sp[:, 2] / self._per_thrust - self._hover
        collective = np.minimum(along_z / body_z[:, 2], -self._thr_min)
        thrust = body_z * collective[:, None]
        horizontal = np.hypot(thrust[:, 0], thrust[:, 1])
        most, wanted_z = self._thr_max**2, thrust[:, 2].copy()
        thrust[:, 2] = np.maximum(
            thrust[:, 2], -np.sqrt(np.maximum(most - np.minimum(horizontal, self._margin) ** 2, 0.0))
        )
        thrust[:, :2] = _limit_length(thrust[:, :2], np.sqrt(np.maximum(most - thrust[:, 2] ** 2, 0.0)))
        self.thrust_n = thrust
        return wanted_z

    def _integrate(self, error: Array, a_sp: Array, thrust_z: Array) -> None:
        """Integrate the velocity error, with anti-windup.

        The vertical integral is frozen while the requested thrust saturates. The limit keeps a margin for
        horizontal thrust, so the limited thrust is smaller than MPC_THR_MAX and does not show the saturation.
        The horizontal integral tracks the thrust that was produced.

        thrust_z: vertical thrust before the limit [-] [NED] (V,)
        """
        e = error.copy()
        z = e[:, 2]
        stuck = ((thrust_z >= -self._thr_min) & (z >= 0)) | ((thrust_z <= -self._thr_max) & (z <= 0))
        e[stuck, 2] = 0.0
        produced = self.thrust_n[:, :2] * self._per_thrust[:, None]
        short = np.hypot(a_sp[:, 0], a_sp[:, 1]) > np.hypot(produced[:, 0], produced[:, 1])
        e[:, :2] -= (short * self._short_gain)[:, None] * (a_sp[:, :2] - produced)
        self.integral += e * self._vi_dt
        # PX4 limits the vertical integral only. An absurd acceleration would wind up the horizontal one for
        # the rest of the flight.
        self.integral = np.minimum(np.maximum(self.integral, -GRAVITY_M_S2), GRAVITY_M_S2)


def attitude_from_thrust(thrust_n: Array, yaw: Array) -> Array:
    """Return the attitude wxyz, w >= 0 (V, 4), whose body z axis is opposite to the thrust.

    thrust_n: thrust vector [-] [NED] (V, 3)
    yaw: heading of the attitude [rad] (V,)
    """
    x, y, z = -thrust_n.T
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, aside = cos * x + sin * y, cos * y - sin * x
    up = np.where(z < 0, -1.0, 1.0)
    rpy = np.empty((len(yaw), 3))
    rpy[:, 0] = np.arctan2(-aside, up * np.hypot(ahead, z))
    rpy[:, 1] = np.arctan2(up * ahead, np.abs(z))
    rpy[:, 2] = yaw
    q = quat_from_euler(rpy)
    return np.asarray(q * np.where(q[:, :1] < 0, -1.0, 1.0))


class AttitudeControl:
    """Attitude controller of V vehicles: computes body rate setpoints from attitude setpoints."""

    def __init__(self, params: Params) -> None:
        self.params = params
        self._read_params()

    def _read_params(self) -> None:
        p = self.params
        self._version = p.version
        self._weight = p["MC_YAW_WEIGHT"]
        gain = p.columns("MC_ROLL_P", "MC_PITCH_P", "MC_YAW_P")
        gain[:, 2] /= np.maximum(self._weight, 1e-6)
        self._gain = gain
        self._limit = np.radians(p.columns("MC_ROLLRATE_MAX", "MC_PITCHRATE_MAX", "MC_YAWRATE_MAX"))

    def update(self, q_nb: Array, r_nb: Array, q_sp: Array, yaw_rate: Array) -> Array:
        """Run the attitude controller. Return the body rate setpoint [rad/s] [FRD] (V, 3).

        q_nb, r_nb: attitude [-] wxyz (V, 4) and its rotation matrix (V, 3, 3)
        q_sp: attitude setpoint [-] wxyz (V, 4)
        yaw_rate: feed-forward rotation about the down axis [rad/s] (V,)
        """
        if self._version != self.params.version:
            self._read_params()
        # The error in body axes is tilt * twist about z; only the twist is weighted, by half its angle. If
        # the two z axes are opposite, the twist is zero and the error is used unweighted.
        error = quat_between(q_nb, q_sp)
        error *= np.where(error[:, :1] < 0, -2.0, 2.0)
        w, x, y, z = error.T
        half = np.arctan2(z, w)
        kept = self._weight * half
        cos, sin = np.cos(half - kept), np.sin(half - kept)
        turn = np.empty_like(r_nb[:, 2])
        turn[:, 0], turn[:, 1] = cos * x - sin * y, cos * y + sin * x
        turn[:, 2] = np.hypot(w, z) * np.sin(kept)
        # Limited before the rotation: otherwise a fast yaw rate saturates every body axis and the vehicle
        # rolls over.
        feed = np.minimum(np.maximum(yaw_rate, -self._limit[:, 2]), self._limit[:, 2])
        # The last row of the rotation matrix is the down axis in body axes.
        rates = turn * self._gain + r_nb[:, 2] * feed[:, None]
        return np.asarray(np.minimum(np.maximum(rates, -self._limit), self._limit))


class RateControl:
    """Rate controller of V vehicles: computes normalised torques from body rates."""

    def __init__(self, params: Params, vehicles: int, dt: float) -> None:
        self.params, self.dt = params, dt
        self.integral = np.zeros((vehicles, 3))
        self._rate, self._accel = np.zeros((vehicles, 3)), np.zeros((vehicles, 3))
        self._yaw_torque = np.zeros(vehicles)
        self._read_params()

    def _read_params(self) -> None:
        p, axes = self.params, ("ROLL", "PITCH", "YAW")
        self._version = p.version
        k = p.columns(*(f"MC_{a}RATE_K" for a in axes))
        self._p = k * p.columns(*(f"MC_{a}RATE_P" for a in axes))
        self._i_dt = k * p.columns(*(f"MC_{a}RATE_I" for a in axes)) * self.dt
        self._d = k * p.columns(*(f"MC_{a}RATE_D" for a in axes))
        self._limit = p.columns("MC_RR_INT_LIM", "MC_PR_INT_LIM", "MC_YR_INT_LIM")
        self._lp_rate = _low_pass(p["IMU_GYRO_CUTOFF"], self.dt)
        self._lp_accel = _low_pass(p["IMU_DGYRO_CUTOFF"], self.dt)
        self._lp_yaw = _low_pass(p["MC_YAW_TQ_CUTOFF"], self.dt)[:, 0]

    def reset(self, which: Bool | int) -> None:
        """Clear the rate integral and the yaw filter of the selected vehicles."""
        self.integral[which] = 0.0
        self._yaw_torque[which] = 0.0

    def update(self, omega_b: Array, omega_sp: Array, saturated: Array) -> Array:
        """Run the rate controller. Return the normalised torque [-] [FRD] (V, 3).

        omega_b, omega_sp: body rates and their setpoint [rad/s] [FRD] (V, 3)
        saturated: sign of the torque that the control allocation could not deliver, for each axis (V, 3)
        """
        if self._version != self.params.version:
            self._read_params()
        last = self._rate
        self._rate = last + self._lp_rate * (omega_b - last)
        self._accel += self._lp_accel * ((self._rate - last) / self.dt - self._accel)
        error = omega_sp - self._rate
        torque = self._p * error + self.integral - self._d * self._accel
        grow = np.where(saturated * error > 0, 0.0, error)
        # Large errors are transients: integrate them less, and none from 400 deg/s on.
        fade = np.maximum(0.0, 1.0 - (error * _INTEGRAL_CUTOFF) ** 2)
        integral = self.integral + fade * grow * self._i_dt
        self.integral = np.minimum(np.maximum(integral, -self._limit), self._limit)
        # Accelerating rotors push back on the body, so the yaw torque is filtered, as on PX4.
        self._yaw_torque += self._lp_yaw * (
            np.minimum(np.maximum(torque[:, 2], -1.0), 1.0) - self._yaw_torque
        )
        torque[:, 2] = self._yaw_torque
        return torque


def steps_within(period_s: float, dt: float) -> int:
    """Return the number of steps of `dt` [s] that lasts nearest to `period_s` [s], at least 1."""
    return max(1, round(period_s / dt))


def _low_pass(cutoff_hz: Array, dt: float) -> Array:
    """Return the coefficient of a first-order low-pass filter for one step (V, 1); 0 Hz disables the filter."""
    return np.where(cutoff_hz > 0, 1.0 - np.exp(-2 * np.pi * np.maximum(cutoff_hz, 1e-3) * dt), 1.0)[:, None]


def _limit_length(v: Array, most: Array) -> Array:
    """Limit the length of each vector (V, 2) to its maximum `most` (V,)."""
    length = np.hypot(v[:, 0], v[:, 1])
    return np.asarray(v * np.minimum(1.0, most / np.maximum(length, 1e-9))[:, None])


def _add_within(first: Array, second: Array, most: Array) -> Array:
    """Return the sum of two vectors (V, 2) that is longer than `most` (V,), shortened to `most`.

    The first vector has priority: it is kept up to the limit, and the second vector is shortened. The sum ends
    where the ray from `first` along `second` leaves the circle of radius `most`.
    """
    kept = _limit_length(first, most)
    length = np.hypot(second[:, 0], second[:, 1])
    along = second / np.maximum(length, 1e-9)[:, None]
    ahead = (along * kept).sum(1)
    left = most * most - (kept * kept).sum(1)
    share = np.sqrt(ahead * ahead + np.maximum(left, 0.0)) - ahead
    share *= left > 1e-9  # the first vector alone reaches the limit
    return np.asarray(kept + along * share[:, None])


def _length(v: Array) -> Array:
    """Return the lengths of vectors (V, 3). This is several times faster than numpy.linalg.norm."""
    return np.asarray(np.hypot(np.hypot(v[:, 0], v[:, 1]), v[:, 2]))


class Cascade:
    """All controllers of V vehicles: compute torques and collective thrust from setpoints and estimates."""

    def __init__(self, params: Params, vehicles: int, dt: float) -> None:
        self._position_every = steps_within(_POSITION_PERIOD_S, dt)
        self.position = PositionControl(params, vehicles, dt * self._position_every)
        self.attitude = AttitudeControl(params)
        self.rate = RateControl(params, vehicles, dt)
        self.q_sp, self.omega_sp = np.tile([1.0, 0.0, 0.0, 0.0], (vehicles, 1)), np.zeros((vehicles, 3))
        self.thrust = np.zeros(vehicles)
        self.saturated = np.zeros((vehicles, 3))
        self.dt = dt
        self._steps = 0

    def reset(self, which: Bool | int) -> None:
        """Clear the integrals and filters of all controllers of the selected vehicles."""
        self.position.reset(which)
        self.rate.reset(which)

    def update(self, sp: Setpoints, est: Estimator) -> tuple[Array, Array]:
        """Run all controllers. Return the normalised torque [-] [FRD] (V, 3) and the collective thrust 0..1 (V,)."""
        by_position = sp.at(Level.POSITION)
        if self._steps % self._position_every == 0:
            q_sp, thrust = self.position.update(sp, est)
            self.q_sp = np.where(by_position[:, None], q_sp, sp.q_nb)
            self.thrust = np.where(by_position, thrust, sp.thrust)
        self._steps += 1
        feed = np.where(by_position & np.isfinite(sp.yaw_rate), sp.yaw_rate, sp.yaw_rate_ff)
        rates = self.attitude.update(est.q_nb, est.r_nb, self.q_sp, feed)
        self.omega_sp = np.where((by_position | sp.at(Level.ATTITUDE))[:, None], rates, sp.omega_b)
        return self.rate.update(est.omega_b, self.omega_sp, self.saturated), self.thrust
