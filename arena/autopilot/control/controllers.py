"""Cascaded controllers from position to body torques, for all vehicles together.

Structure and parameter names are PX4's:

    position P -> velocity PID -> acceleration -> thrust vector and attitude -> attitude P on the quaternion
    -> rate PID

The formulas are in `arena.kernels`. These classes read the parameters and own the arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.param_table import Params
from arena.kernels.arrays import array, integers, view
from arena.kernels.attitude_control import AttitudeLaw
from arena.kernels.cascade import CascadeLaw
from arena.kernels.position_control import PositionLaw
from arena.kernels.rate_control import RateLaw
from arena.portable_math import exp

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]

_POSITION_PERIOD_S = 0.008  # of the position loop


class PositionControl:
    """Position and velocity controller of V vehicles: computes attitude and collective thrust from setpoints.

    integral: integral of the velocity error [m/s2] [NED] (V, 3)
    thrust_n: normalised thrust vector [-] [NED] (V, 3)
    v_sp_n, a_sp_n: velocity [m/s] and acceleration [m/s2] setpoint [NED] (V, 3)
    speed_up: limit of the climb rate, set by the take-off ramp [m/s] (V,)
    tilt_max: limit of the tilt, set by the take-off ramp [rad] (V,)
    """

    def __init__(self, params: Params, vehicles: int, dt: float) -> None:
        self.params, self.dt = params, dt
        self.law = law = PositionLaw(vehicles, dt)
        self.integral, self.thrust_n = array(law.integral), array(law.thrust_n)
        self.v_sp_n, self.a_sp_n = array(law.v_sp_n), array(law.a_sp_n)
        self.speed_up, self.tilt_max = array(law.speed_up), array(law.tilt_max)
        self._v_dot = array(law.v_dot)
        self._inputs = array(law.p_n), array(law.v_n), array(law.q_nb)
        self._sp: Setpoints | None = None
        self._read_params()

    def _read_params(self) -> None:
        p, law = self.params, self.law
        self._version = p.version
        vi = p.columns("MPC_XY_VEL_I_ACC", "MPC_XY_VEL_I_ACC", "MPC_Z_VEL_I_ACC")
        array(law.p)[:] = p.columns("MPC_XY_P", "MPC_XY_P", "MPC_Z_P")
        array(law.vp)[:] = p.columns("MPC_XY_VEL_P_ACC", "MPC_XY_VEL_P_ACC", "MPC_Z_VEL_P_ACC")
        array(law.vi_dt)[:] = vi * self.dt
        array(law.vd)[:] = p.columns("MPC_XY_VEL_D_ACC", "MPC_XY_VEL_D_ACC", "MPC_Z_VEL_D_ACC")
        array(law.hover)[:], array(law.margin)[:] = p["MPC_THR_HOVER"], p["MPC_THR_XY_MARG"]
        array(law.thr_min)[:], array(law.thr_max)[:] = p["MPC_THR_MIN"], p["MPC_THR_MAX"]
        array(law.xy_max)[:], array(law.up_max)[:] = p["MPC_XY_VEL_MAX"], p["MPC_Z_VEL_MAX_UP"]
        array(law.down_max)[:], array(law.tilt_air)[:] = (
            p["MPC_Z_VEL_MAX_DN"],
            np.radians(p["MPC_TILTMAX_AIR"]),
        )
        cutoff = p["MPC_VELD_LP"]
        array(law.low_pass)[:] = self.dt / (self.dt + 1.0 / (2 * np.pi * np.maximum(cutoff, 1e-3)))

    def reset(self, which: Bool | int) -> None:
        """Clear the velocity integral and the filtered acceleration of the selected vehicles."""
        self.integral[which] = 0.0
        self._v_dot[which] = 0.0

    def begin(self, sp: Setpoints) -> None:
        """Read changed parameters, and give the compiled controller access to the setpoint arrays.

        Only the setpoints for the position controller are used.
        """
        if self._version != self.params.version:
            self._read_params()
        if sp is not self._sp:
            self._sp = sp
            self.law.read_setpoints_from(view(sp.p_n), view(sp.v_n), view(sp.a_n), view(sp.yaw))

    def prepare(self, sp: Setpoints, est: Estimator) -> None:
        """Prepare all inputs of the compiled position controller (attribute `law`).

        sp: setpoints
        est: estimator of all vehicles
        """
        self.begin(sp)
        for to, estimate in zip(self._inputs, (est.p_n, est.v_n, est.q_nb), strict=True):
            to[...] = estimate

    def update(self, sp: Setpoints, est: Estimator) -> tuple[Array, Array]:
        """Run the position and velocity controller.

        Return the attitude setpoint [-] wxyz (V, 4) and the collective thrust 0..1 (V,).
        """
        self.prepare(sp, est)
        self.law.step()
        return array(self.law.q_sp), array(self.law.thrust)


class AttitudeControl:
    """Attitude controller of V vehicles: computes body rate setpoints from attitude setpoints."""

    def __init__(self, params: Params, vehicles: int) -> None:
        self.params, self.law = params, AttitudeLaw(vehicles)
        self._inputs = array(self.law.q_nb), array(self.law.r_nb)
        self._read_params()

    def _read_params(self) -> None:
        p, law = self.params, self.law
        self._version = p.version
        gain = p.columns("MC_ROLL_P", "MC_PITCH_P", "MC_YAW_P")
        gain[:, 2] /= np.maximum(p["MC_YAW_WEIGHT"], 1e-6)
        array(law.gain)[:], array(law.yaw_weight)[:] = gain, p["MC_YAW_WEIGHT"]
        array(law.rate_limit)[:] = np.radians(
            p.columns("MC_ROLLRATE_MAX", "MC_PITCHRATE_MAX", "MC_YAWRATE_MAX")
        )

    def begin(self) -> None:
        """Read the parameters of the controller again if they have changed."""
        if self._version != self.params.version:
            self._read_params()

    def prepare(self, q_nb: Array, r_nb: Array) -> None:
        """Copy the attitude estimates to the compiled attitude controller (attribute `law`).

        q_nb, r_nb: attitude [-] wxyz (V, 4) and its rotation matrix (V, 3, 3)
        """
        self.begin()
        self._inputs[0][...], self._inputs[1][...] = q_nb, r_nb

    def update(self, q_nb: Array, r_nb: Array, q_sp: Array, yaw_rate: Array) -> Array:
        """Run the attitude controller. Return the body rate setpoint [rad/s] [FRD] (V, 3).

        q_nb, r_nb: attitude [-] wxyz (V, 4) and its rotation matrix (V, 3, 3)
        q_sp: attitude setpoint [-] wxyz (V, 4)
        yaw_rate: feed-forward rotation about the down axis [rad/s] (V,)
        """
        self.prepare(q_nb, r_nb)
        array(self.law.q_sp)[:], array(self.law.yaw_rate)[:] = q_sp, yaw_rate
        self.law.step()
        return array(self.law.rates)


class RateControl:
    """Rate controller of V vehicles: computes normalised torques from body rates and their setpoints.

    integral: integral of the rate error [-] [FRD] (V, 3)
    """

    def __init__(self, params: Params, vehicles: int, dt: float) -> None:
        self.params, self.dt = params, dt
        self.law = RateLaw(vehicles, dt)
        self.integral, self._omega_b = array(self.law.integral), array(self.law.omega_b)
        self._yaw_torque = array(self.law.yaw_torque)
        self._read_params()

    def _read_params(self) -> None:
        p, law, axes = self.params, self.law, ("ROLL", "PITCH", "YAW")
        self._version = p.version
        k = p.columns(*(f"MC_{a}RATE_K" for a in axes))
        array(law.p)[:] = k * p.columns(*(f"MC_{a}RATE_P" for a in axes))
        array(law.i_dt)[:] = k * p.columns(*(f"MC_{a}RATE_I" for a in axes)) * self.dt
        array(law.d)[:] = k * p.columns(*(f"MC_{a}RATE_D" for a in axes))
        array(law.integral_limit)[:] = p.columns("MC_RR_INT_LIM", "MC_PR_INT_LIM", "MC_YR_INT_LIM")
        cutoffs = p.columns("IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF", "MC_YAW_TQ_CUTOFF")
        array(law.low_pass)[:] = _low_pass(cutoffs, self.dt)

    def reset(self, which: Bool | int) -> None:
        """Clear the rate integral and the yaw filter of the selected vehicles."""
        self.integral[which] = 0.0
        self._yaw_torque[which] = 0.0

    def begin(self) -> None:
        """Read the parameters of the controller again if they have changed."""
        if self._version != self.params.version:
            self._read_params()

    def prepare(self, omega_b: Array) -> None:
        """Copy the body rates [rad/s] [FRD] (V, 3) to the compiled rate controller (attribute `law`)."""
        self.begin()
        self._omega_b[...] = omega_b

    def update(self, omega_b: Array, omega_sp: Array, saturated: Array) -> Array:
        """Run the rate controller. Return the normalised torque [-] [FRD] (V, 3).

        omega_b, omega_sp: body rates and their setpoint [rad/s] [FRD] (V, 3)
        saturated: sign of the torque that the control allocation could not deliver, for each axis (V, 3)
        """
        self.prepare(omega_b)
        array(self.law.omega_sp)[:], array(self.law.saturated)[:] = omega_sp, saturated
        self.law.step()
        return array(self.law.torque)


def steps_per_period(period_s: float, dt: float) -> int:
    """Return the rounded number of time steps `dt` [s] in a period [s]; at least 1."""
    return max(1, round(period_s / dt))


def _low_pass(cutoff_hz: Array, dt: float) -> Array:
    """Return the coefficients of discrete first-order low-pass filters with the time step `dt` [s].

    The result has the shape of `cutoff_hz`. A cut-off of 0 Hz disables the filter.
    """
    return np.where(cutoff_hz > 0, 1.0 - exp(-2 * np.pi * np.maximum(cutoff_hz, 1e-3) * dt), 1.0)


class Cascade:
    """All controllers of V vehicles: compute torques and collective thrust from setpoints and estimates.

    q_sp, omega_sp: attitude setpoint wxyz (V, 4) and rate setpoint [rad/s] [FRD] (V, 3)
    thrust: collective thrust 0..1 (V,)
    saturated: sign of the torque that the control allocation could not deliver, for each axis (V, 3)
    law: the compiled controllers
    """

    def __init__(self, params: Params, vehicles: int, dt: float) -> None:
        self._position_every = steps_per_period(_POSITION_PERIOD_S, dt)
        self.position = PositionControl(params, vehicles, dt * self._position_every)
        self.attitude = AttitudeControl(params, vehicles)
        self.rate = RateControl(params, vehicles, dt)
        self.q_sp, self.omega_sp = array(self.attitude.law.q_sp), array(self.rate.law.omega_sp)
        self.q_sp[:] = (1.0, 0.0, 0.0, 0.0)
        self.thrust, self.saturated = np.zeros(vehicles), array(self.rate.law.saturated)
        self.dt = dt
        self._torque = array(self.rate.law.torque)
        self.law = CascadeLaw(self.position.law, self.attitude.law, self.rate.law, view(self.thrust))
        self._sp: Setpoints | None = None
        self._steps = 0

    def reset(self, which: Bool | int) -> None:
        """Clear the integrals and filters of all controllers of the selected vehicles."""
        self.position.reset(which)
        self.rate.reset(which)

    def begin(self, sp: Setpoints) -> bool:
        """Begin a step of all controllers. Return whether the position controller runs in this step.

        Changed parameters are read, and the setpoint arrays are remembered. The caller writes the other
        inputs of the compiled controller `law`.
        """
        if sp is not self._sp:
            self._sp = sp
            given = (sp.q_nb, sp.omega_b, sp.thrust, sp.yaw_rate, sp.yaw_rate_ff)
            self.law.read_setpoints_from(integers(sp.level), *(view(each) for each in given))
        self.position.begin(sp)
        self.attitude.begin()
        self.rate.begin()
        with_position = self._steps % self._position_every == 0
        self._steps += 1
        return with_position

    def update(self, sp: Setpoints, est: Estimator) -> tuple[Array, Array]:
        """Run all controllers. Return the normalised torque [-] [FRD] (V, 3) and the collective thrust 0..1 (V,)."""
        with_position = self.begin(sp)
        if with_position:
            self.position.prepare(sp, est)
        self.attitude.prepare(est.q_nb, est.r_nb)
        self.rate.prepare(est.omega_b)
        self.law.step(with_position)
        return self._torque, self.thrust
