"""Error-state Kalman filter: predicts pose and velocity from the IMU, and corrects them by external vision.

All vehicles are computed together.

Nominal state at the present time: p_n, v_n, q_nb, gyro bias, accelerometer bias.
Error state of 15 numbers, in this order, with q_true = q_nb * exp(dtheta_b):

    dp_n, dv_n, dtheta_b, dbg, dba

A measurement of age tau is compared with the state that was stored at its time, and its Jacobian contains the
age: to first order dp(t - tau) = dp - tau dv. So the filter predicts each state only once. A correction
changes the present state and the stored states together.

The filter fuses only the yaw of the measured attitude (the rotation about the down axis). It estimates the
tilt from the motion, so a rigid body that was defined with a tilt error does no harm.

Error dynamics: Sola, "Quaternion kinematics for the error-state Kalman filter", 2017. Noise parameters, gates
and timeouts have PX4's names and meaning.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.estimation.prediction_period import samples_per_prediction
from arena.autopilot.param_table import Params
from arena.builtin_parameters import SPECS
from arena.constants import GRAVITY_M_S2
from arena.geometry import matrix_from_quat, quat_from_euler, quat_normalize, yaw_from_quat
from arena.kernels.arrays import array, view
from arena.kernels.barometer_offset import BarometerOffset
from arena.kernels.error_covariance import ErrorCovariance
from arena.kernels.estimate_validity import EstimateValidity
from arena.kernels.strapdown import Strapdown
from arena.kernels.vision_fusion import VisionFusion
from arena.kernels.vision_input import VisionInput
from arena.portable_math import arctan2

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]
Index = NDArray[np.intp]

_FORCE_MEAN_S = 0.2  # time constant of the mean specific force
_BARO_AFTER_S = 0.5  # from the last height of vision until the barometer is fused
_NEVER = -1e9
_SETTLE_S = 1.0  # from the alignment until the estimate is valid
_BARO_VARIANCE = 0.25  # [m2]
_VELOCITY_VARIANCE = 0.16  # limit of a valid velocity [m2/s2]
_VALID_VARIANCE = np.repeat(
    (0.25, _VELOCITY_VARIANCE, 0.01), 3
)  # limits of a valid position [m2], velocity [m2/s2] and attitude [rad2]


class Estimator:
    """Estimator of position, velocity, attitude and IMU biases of V vehicles.

    dt: IMU period [s]
    p_n, v_n, a_n: position [m], velocity [m/s], acceleration [m/s2] [NED] (V, 3)
    q_nb, r_nb: attitude wxyz (V, 4) and its rotation matrix (V, 3, 3)
    omega_b: body rates without bias [rad/s] [FRD] (V, 3)
    sensed_accel_b, sensed_gyro_b: last measurements of the IMU [m/s2], [rad/s] [FRD] (V, 3)
    force_b: specific force without bias [m/s2] [FRD] (V, 3)
    law: the compiled prediction, which owns these arrays
    validity: the compiled decision which estimates are valid; `valid` updates it
    cov: covariance of the error state (V, 15, 15)
    aligned: True if the initial attitude is set (V,)
    test_ratio: squared innovation divided by its gate, for position and yaw [-] (V, 2)
    innovation, innovation_var: innovations of position [m] [NED] and yaw [rad], and their variances [m2]
        [rad2] (V, 4)
    tilt, pose_rejected: tilt [rad] (V,), and whether the last pose was rejected (V,), both at the last call of
        `xy_valid`, `z_valid` or `yaw_valid`
    rejected, reset_counter: number of rejected samples, and number of realignments (V,)
    at_rest: True while the vehicle stands on the ground with idle motors, set by the caller. Only such a
        vehicle aligns again with poses that the gate rejects for EKF2_NOAID_TOUT (V,)
    baro_failed: True for a failed barometer, set by the caller (V,)
    vision_input: poses of external vision, from their arrival to their fusion
    """

    def __init__(self, params: Params, vehicles: int, dt: float) -> None:
        v = vehicles
        self.params, self.dt = params, dt
        self.aligned, self.at_rest = np.zeros(v, bool), np.zeros(v, bool)
        # Past states for the largest EKF2_EV_DELAY, half a period and the interpolation.
        past_states = math.ceil(1e-3 * SPECS["EKF2_EV_DELAY"].high / dt) + 3
        self.law = state = Strapdown(self.aligned, dt, min(1.0, dt / _FORCE_MEAN_S), past_states)
        self.p_n, self.v_n, self.a_n = array(state.p_n), array(state.v_n), array(state.a_n)
        self.q_nb, self.r_nb, self.omega_b = array(state.q_nb), array(state.r_nb), array(state.omega_b)
        self.gyro_bias, self.accel_bias = array(state.gyro_bias), array(state.accel_bias)
        self.sensed_accel_b, self.sensed_gyro_b = array(state.sensed_accel_b), array(state.sensed_gyro_b)
        self.force_b = array(state.force_b)
        self._accel_mean = array(state.accel_mean)
        self._ring_p, self._ring_q = array(state.ring_p), array(state.ring_q)
        self.q_nb[:, 0] = self._ring_q[..., 0] = 1.0
        self.r_nb[:] = np.eye(3)
        self._accel_mean[:, 2] = -GRAVITY_M_S2
        samples = samples_per_prediction(dt)
        self._covariance = ErrorCovariance(dt, samples, state.r_nb, state.force_b, state.omega_b)
        self.cov = array(self._covariance.cov)
        self._ctrl, self.rejected = np.zeros(v, int), np.zeros(v, int)
        self._vision = vision = VisionFusion(state, self._covariance, self._ctrl, self.rejected)
        self.vision_input = VisionInput(vision, self.at_rest)
        self._delay_s, self._rejected_since = array(vision.delay_s), array(vision.rejected_since)
        self.test_ratio, self._gate_var = array(vision.test_ratio), array(vision.gate_var)
        self.innovation, self.innovation_var = array(vision.innovation), array(vision.innovation_var)
        self.last_xy, self.last_z = array(vision.last_xy), array(vision.last_z)
        self.last_yaw = array(vision.last_yaw)
        self.last_xy[:] = self.last_z[:] = self.last_yaw[:] = _NEVER
        self._xy_valid, self._z_valid, self._yaw_valid, self.pose_rejected = np.zeros((4, v), bool)
        self.validity = validity = EstimateValidity(
            state,
            vision,
            self._covariance.cov,
            view(_VALID_VARIANCE),
            _SETTLE_S,
            self._xy_valid,
            self._z_valid,
            self._yaw_valid,
            self.pose_rejected,
        )
        self.tilt = array(validity.tilt)
        self.aligned_at, self.reset_counter = array(validity.aligned_at), np.zeros(v, int)
        self._without_vision, self.baro_failed = np.zeros(v, bool), np.zeros(v, bool)
        self._baro = baro = BarometerOffset(state, vision, np.zeros(v, bool), self._without_vision)
        self._baro_altitude, self._baro_offset = array(baro.altitude), array(baro.offset)
        self.last_baro = array(validity.last_baro)  # time of the last fusion [s]
        self.last_baro[:] = _NEVER
        self._timeout_s = array(validity.timeout_s)
        self._height = np.zeros((1, 15))  # derivatives of the position D by the error state
        self._height[0, 2] = 1.0
        self._read_params()

    def _read_params(self) -> None:
        p = self.params
        self._version = p.version
        self._timeout_s[:] = p["EKF2_NOAID_TOUT"] * 1e-6
        self._delay_s[:] = p["EKF2_EV_DELAY"] * 1e-3
        self._ctrl[:] = p["EKF2_EV_CTRL"]
        array(self._baro.after_s)[:] = np.where(
            p["EKF2_BARO_CTRL"] > 0, np.minimum(_BARO_AFTER_S, 0.5 * self._timeout_s), np.inf
        )
        variances = p.columns("EKF2_EVP_NOISE", "EKF2_EVA_NOISE") ** 2
        array(self._vision.least_variance)[:] = variances[:, (0, 0, 0, 1)]
        array(self._vision.gate_squared)[:] = p.columns("EKF2_EVP_GATE", "EKF2_HDG_GATE") ** 2
        vision = self.vision_input
        array(vision.align_after_s)[:] = self._timeout_s
        np.asarray(vision.ignores_variances)[:] = p["EKF2_EV_NOISE_MD"] != 0
        array(vision.offset_b)[:] = p.columns("EKF2_EV_POS_X", "EKF2_EV_POS_Y", "EKF2_EV_POS_Z")
        array(self.law.bias_limit)[:] = p["EKF2_ABL_LIM"]
        # Velocity, attitude and both biases. As in PX4, each prediction adds (noise * period)^2.
        noise = p.columns("EKF2_ACC_NOISE", "EKF2_GYR_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE").repeat(
            3, axis=1
        )
        array(self._covariance.growth)[:] = (noise * self.dt * self._covariance.samples) ** 2

    # -- validity --------------------------------------------------------------------------------------------

    def xy_valid(self, now: float) -> Bool:
        """Return a mask (V,) of the vehicles whose horizontal position and velocity are valid.

        The next call overwrites the mask.

        They are valid if vision was fused within the last EKF2_NOAID_TOUT and the filter has converged.
        """
        self.validity.update(now)
        return self._xy_valid

    def z_valid(self, now: float) -> Bool:
        """Return a mask (V,) of the vehicles whose height is valid.

        The next call overwrites the mask.

        It is valid if the height of vision or of the barometer was fused within the last EKF2_NOAID_TOUT. PX4
        has the same timeout (`valid_timeout_max` in EKF2).
        """
        self.validity.update(now)
        return self._z_valid

    def yaw_valid(self, now: float) -> Bool:
        """Return a mask (V,) of the vehicles whose heading is valid.

        The next call overwrites the mask.

        It is valid if yaw was fused within the last EKF2_NOAID_TOUT, or if the parameters disable yaw fusion.
        """
        self.validity.update(now)
        return self._yaw_valid

    def valid(self, now: float) -> tuple[Bool, Bool, Bool]:
        """Return the masks of `xy_valid`, `z_valid` and `yaw_valid`, which the next call overwrites."""
        self.validity.update(now)
        return self._xy_valid, self._z_valid, self._yaw_valid

    def velocity_known(self, i: int) -> bool:
        """Return whether the velocity of vehicle i is known well enough to brake without external vision."""
        return bool(self.aligned[i] and max(self.cov[i, 3, 3], self.cov[i, 4, 4]) < _VELOCITY_VARIANCE)

    def specific_force(self) -> Array:
        """Return the magnitude of the specific force [m/s2] (V,), averaged over 0.2 s; 9.8 at rest."""
        return np.asarray(np.sqrt((self._accel_mean * self._accel_mean).sum(1)))

    # -- prediction ------------------------------------------------------------------------------------------

    def predict(self, accel_b: Array, gyro_b: Array) -> None:
        """Advance the estimated state by one IMU period, from the measurements of accelerometer and gyroscope.

        accel_b: specific force [m/s2] [FRD] (V, 3)
        gyro_b: body rates [rad/s] [FRD] (V, 3)
        """
        if self._version != self.params.version:
            self._read_params()
        self.sensed_accel_b[...], self.sensed_gyro_b[...] = accel_b, gyro_b
        self.law.step()
        self._covariance.step()

    # -- correction ------------------------------------------------------------------------------------------

    def fuse_vision(self, now: float) -> None:
        """Fuse the poses that have arrived in this IMU period, or align the estimates with them.

        The age of a pose is EKF2_EV_DELAY, as PX4 assumes for poses that are stamped on arrival.

        now: time since boot [s]
        """
        if self._version != self.params.version:
            self._read_params()
        for i in self.vision_input.fuse(now):
            idx, pose = np.array([i]), array(self.vision_input.prepared)[i : i + 1]
            if self.aligned[i]:
                self.realign(idx)
            self._align(idx, pose[:, :3], pose[:, 3:7], now)

    def fuse_baro(self, baro_alt_m: Array, now: float) -> None:
        """Fuse the barometer if vision gives no height; otherwise estimate the offset of the barometer.

        baro_alt_m: altitude, up [m]; not used if it is NaN or where `baro_failed` is set (V,)
        now: time since boot [s]
        """
        if self._version != self.params.version:
            self._read_params()
        self._baro_altitude[...] = baro_alt_m
        self._baro_altitude[self.baro_failed] = np.nan
        if self._baro.update(now):
            lost = self._without_vision
            self.last_baro[lost] = now
            for i in np.flatnonzero(lost).tolist():
                self._fuse_height(i, float(self._baro_offset[i] - baro_alt_m[i]))

    def _fuse_height(self, i: int, down: float) -> None:
        """Correct the estimate of vehicle i by a measurement of the barometer.

        down: measured position [m] [NED down]
        """
        covariance = self._covariance
        covariance.begin()
        covariance.correct(i, view(self._height), 0, down - float(self.p_n[i, 2]), _BARO_VARIANCE)
        covariance.repair(i)
        self.law.correct(i, covariance.error, int(self._delay_s[i] / self.dt) + 3)

    def realign(self, idx: Index) -> None:
        """Restart the initial alignment of the estimates of some vehicles. idx: rows of these vehicles

        The next vision sample of each vehicle sets its tilt, heading and position again.

        The IMU biases are kept. Call this method only for vehicles on the ground.
        """
        self.aligned[idx] = False
        self.reset_counter[idx] += 1

    def _align(self, idx: Index, p_n: Array, q_nb: Array, now: float) -> None:
        """Align the estimates of vehicles at rest: set tilt from gravity, heading and position from vision."""
        ok = np.isfinite(q_nb[:, 0])
        idx, p_n, q_nb = idx[ok], p_n[ok], q_nb[ok]
        if not len(idx):
            return
        down_b = -self._accel_mean[idx]
        roll = arctan2(down_b[:, 1], down_b[:, 2])
        pitch = arctan2(-down_b[:, 0], np.hypot(down_b[:, 1], down_b[:, 2]))
        self.q_nb[idx] = quat_normalize(
            quat_from_euler(np.stack([roll, pitch, yaw_from_quat(q_nb)], axis=-1))
        )
        self.r_nb[idx] = matrix_from_quat(self.q_nb[idx])
        self.p_n[idx], self.v_n[idx] = p_n, 0.0
        self._ring_p[:, idx], self._ring_q[:, idx] = p_n, self.q_nb[idx]
        sigma = np.array([0.1] * 3 + [0.1] * 3 + [0.05, 0.05, 0.1] + [0.02] * 3 + [0.1] * 3)
        self.cov[idx] = np.diag(sigma**2)
        self.aligned[idx], self.aligned_at[idx] = True, now
        self._gate_var[idx] = self._rejected_since[idx] = np.inf
        self.last_xy[idx] = self.last_z[idx] = self.last_yaw[idx] = now
