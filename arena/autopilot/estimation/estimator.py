"""Error-state Kalman filter, batched over vehicles: IMU prediction, corrected by delayed external vision.

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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.estimation.covariance import CovariancePrediction, repaired
from arena.autopilot.param_table import Params
from arena.builtin_parameters import SPECS
from arena.constants import GRAVITY_M_S2
from arena.geometry import (
    matrix_from_quat,
    quat_conj,
    quat_exp,
    quat_from_euler,
    quat_log,
    quat_multiply,
    quat_normalize,
    yaw_from_quat,
)

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]
Index = NDArray[np.intp]
Triple = tuple[float, float, float]

_P, _V, _TH, _BG, _BA = (slice(i, i + 3) for i in range(0, 15, 3))
_FORCE_MEAN_S = 0.2  # time constant of the mean specific force
_BARO_OFFSET_S = 1.0  # time constant of the barometer's offset
_BARO_AFTER_S = 0.5  # from the last height of vision until the barometer is fused
_NEVER = -1e9
_SETTLE_S = 1.0  # from the alignment until the estimate is valid
_UNUSED_VARIANCE = 1e9
_VELOCITY_VARIANCE = 0.16  # limit of a valid velocity [m2/s2]
_VALID_VARIANCE = np.repeat(
    (0.25, _VELOCITY_VARIANCE, 0.01), 3
)  # limits of a valid position [m2], velocity [m2/s2] and attitude [rad2]


class VisionSample(NamedTuple):
    """Pose measured by external vision.

    p_n: position [m] [NED]
    q_nb: attitude [-] wxyz, NaN if not given
    var_p: variance of the position [m2], 0 if the sender gives none
    var_yaw: variance of the heading [rad2], 0 if the sender gives none
    """

    p_n: Triple
    q_nb: tuple[float, float, float, float]
    var_p: Triple
    var_yaw: float


class Estimator:
    """Estimator of position, velocity, attitude and IMU biases of V vehicles.

    dt: IMU period [s]
    p_n, v_n, a_n: position [m], velocity [m/s], acceleration [m/s2] [NED] (V, 3)
    q_nb, r_nb: attitude wxyz (V, 4) and its rotation matrix (V, 3, 3)
    omega_b: body rates without bias [rad/s] [FRD] (V, 3)
    cov: covariance of the error state (V, 15, 15)
    aligned: True if the initial attitude is set (V,)
    test_ratio: squared innovation divided by its gate, for position and yaw [-] (V, 2)
    innovation, innovation_var: innovations of position [m] [NED] and yaw [rad], and their variances [m2]
        [rad2] (V, 4)
    rejected, reset_counter: number of rejected samples, and number of realignments (V,)
    at_rest: True while the vehicle stands on the ground with idle motors, set by the caller. Only such a
        vehicle aligns again with poses that the gate rejects for EKF2_NOAID_TOUT (V,)
    """

    def __init__(self, params: Params, vehicles: int, dt: float) -> None:
        v = vehicles
        self.params, self.dt = params, dt
        self.p_n, self.v_n, self.a_n = np.zeros((v, 3)), np.zeros((v, 3)), np.zeros((v, 3))
        self.q_nb = np.tile([1.0, 0.0, 0.0, 0.0], (v, 1))
        self.r_nb = np.tile(np.eye(3), (v, 1, 1))
        self.gyro_bias, self.accel_bias = np.zeros((v, 3)), np.zeros((v, 3))
        self.omega_b = np.zeros((v, 3))
        self.cov = np.zeros((v, 15, 15))
        self.aligned = np.zeros(v, bool)
        self.aligned_at = np.full(v, np.inf)
        self.last_xy, self.last_z, self.last_yaw = np.full(v, _NEVER), np.full(v, _NEVER), np.full(v, _NEVER)
        self.rejected = np.zeros(v, int)
        self.reset_counter = np.zeros(v, int)
        self.at_rest = np.zeros(v, bool)
        self._rejected_since = np.full(v, np.inf)  # time of the first of the latest rejections in a row [s]
        self.test_ratio = np.zeros((v, 2))
        self.innovation = np.zeros((v, 4))
        self.innovation_var = np.ones((v, 4))  # variances that the filter assumes for them [m2], [rad2]
        self._gate_var = np.full(
            (v, 4), np.inf
        )  # variance of each gate at its first rejection, infinite if passed
        self._accel_mean = np.tile([0.0, 0.0, -GRAVITY_M_S2], (v, 1))
        self._baro_offset, self._baro_seen = np.zeros(v), np.zeros(v, bool)
        self._last_baro, self._baro_at = np.full(v, _NEVER), _NEVER  # last fusion of each, and last call [s]
        # Stored past states, for the largest EKF2_EV_DELAY, half a period and the interpolation.
        self._ring = math.ceil(1e-3 * SPECS["EKF2_EV_DELAY"].high / dt) + 3
        self._ring_p, self._ring_q = np.zeros((self._ring, v, 3)), np.zeros((self._ring, v, 4))
        self._ring_q[..., 0] = 1.0
        self._steps = 0
        self._prediction = CovariancePrediction(v, dt)
        self._read_params()

    def _read_params(self) -> None:
        p = self.params
        self._version = p.version
        self._timeout_s = p["EKF2_NOAID_TOUT"] * 1e-6
        self._delay_s = p["EKF2_EV_DELAY"] * 1e-3
        self._ctrl = p["EKF2_EV_CTRL"].astype(int)
        self._least_variance = (p.columns("EKF2_EVP_NOISE", "EKF2_EVA_NOISE") ** 2)[:, (0, 0, 0, 1)]
        self._gate_squared = p.columns("EKF2_EVP_GATE", "EKF2_HDG_GATE") ** 2
        # Velocity, attitude and both biases. As in PX4, each prediction adds (noise * period)^2.
        noise = p.columns("EKF2_ACC_NOISE", "EKF2_GYR_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE").repeat(
            3, axis=1
        )
        self._prediction.growth = (noise * self._prediction.period_s) ** 2

    # -- validity --------------------------------------------------------------------------------------------

    def xy_valid(self, now: float) -> Bool:
        """Return a mask of the vehicles whose horizontal position and velocity are valid (V,).

        They are valid if vision was fused within the last EKF2_NOAID_TOUT and the filter has converged.
        """
        return np.asarray(self.aligned & (now - self.last_xy < self._timeout_s) & self._converged(now))

    def z_valid(self, now: float) -> Bool:
        """Return a mask of the vehicles whose height is valid (V,).

        It is valid if the height of vision or of the barometer was fused within the last EKF2_NOAID_TOUT. PX4
        has the same timeout (`valid_timeout_max` in EKF2).
        """
        last = np.maximum(self.last_z, self._last_baro)
        return np.asarray(self.aligned & (now - last < self._timeout_s))

    def yaw_valid(self, now: float) -> Bool:
        """Return a mask of the vehicles whose heading is valid (V,).

        It is valid if yaw was fused within the last EKF2_NOAID_TOUT, or if the parameters disable yaw fusion.
        """
        return np.asarray(self.aligned & ((now - self.last_yaw < self._timeout_s) | (self._ctrl & 8 == 0)))

    def velocity_known(self, i: int) -> bool:
        """Return whether the estimated velocity of vehicle i is accurate enough to stop the vehicle without external vision."""
        return bool(self.aligned[i] and max(self.cov[i, 3, 3], self.cov[i, 4, 4]) < _VELOCITY_VARIANCE)

    def specific_force(self) -> Array:
        """Return the magnitude of the specific force, averaged over 0.2 s [m/s2] (V,). At rest the magnitude is 9.8 m/s2."""
        return np.asarray(np.sqrt((self._accel_mean * self._accel_mean).sum(1)))

    def _converged(self, now: float) -> Bool:
        d = np.einsum("vii->vi", self.cov)[:, :9]
        return np.asarray((d < _VALID_VARIANCE).all(1) & (now - self.aligned_at > _SETTLE_S))

    # -- prediction ------------------------------------------------------------------------------------------

    def predict(self, accel_b: Array, gyro_b: Array) -> None:
        """Advance the estimated state by one IMU period, by accelerometer and gyroscope.

        accel_b: specific force [m/s2] [FRD] (V, 3)
        gyro_b: body rates [rad/s] [FRD] (V, 3)
        """
        if self._version != self.params.version:
            self._read_params()
        dt = self.dt
        omega_b = gyro_b - self.gyro_bias
        force_b = accel_b - self.accel_bias
        self._accel_mean += min(1.0, dt / _FORCE_MEAN_S) * (accel_b - self._accel_mean)
        # The gyroscope measures the rates at the end of the period, the accelerometer the mean over the
        # period.
        self.q_nb = quat_multiply(self.q_nb, quat_exp((self.omega_b + omega_b) * (0.5 * dt)))
        self.q_nb /= np.sqrt((self.q_nb * self.q_nb).sum(1))[:, None]
        self.omega_b, before = omega_b, self.r_nb
        self.r_nb = matrix_from_quat(self.q_nb)
        a_n = ((self.r_nb + before) @ (0.5 * force_b[:, :, None]))[:, :, 0]
        a_n[:, 2] += GRAVITY_M_S2
        self.a_n = a_n
        moving = self.aligned[:, None]
        dv = a_n * dt * moving
        self.p_n = self.p_n + self.v_n * dt + 0.5 * dt * dv
        self.v_n = self.v_n + dv
        slot = self._steps % self._ring
        self._ring_p[slot], self._ring_q[slot] = self.p_n, self.q_nb
        self._steps += 1
        self.cov = self._prediction.advance(self.cov, force_b, omega_b, self.r_nb)

    # -- correction ------------------------------------------------------------------------------------------

    def fuse_vision(
        self, idx: Index, p_n: Array, q_nb: Array, var_p: Array, var_yaw: Array, now: float
    ) -> None:
        """Fuse one sample of external vision, received in this IMU period, for each of m vehicles.

        The age of a sample is EKF2_EV_DELAY, as PX4 assumes for samples that are stamped on arrival.

        idx: rows of the vehicles (m,)
        p_n: position [m] [NED] (m, 3)
        q_nb: attitude [-] wxyz, NaN if not given (m, 4)
        var_p, var_yaw: variances [m2] (m, 3) and [rad2] (m,)
        now: time since boot [s]
        """
        rejected_s = now - self._rejected_since[idx]
        lost = self.at_rest[idx] & np.isfinite(q_nb[:, 0]) & (rejected_s >= self._timeout_s[idx])
        self.realign(idx[lost & self.aligned[idx]])
        fresh = ~self.aligned[idx]
        if fresh.any():
            self._align(idx[fresh], p_n[fresh], q_nb[fresh], var_p[fresh], now)
            idx = idx[~fresh]
            p_n, q_nb, var_p, var_yaw = (x[~fresh] for x in (p_n, q_nb, var_p, var_yaw))
        if not len(idx):
            return
        delay = self._delay_s[idx] + 0.5 * self.dt
        past_p, past_q = self._past(idx, delay)
        y = np.zeros((len(idx), 4))
        y[:, :3] = p_n - past_p
        has_yaw = np.isfinite(q_nb[:, 0]) & (self._ctrl[idx] & 8 > 0)
        q_measured = np.where(has_yaw[:, None], q_nb, past_q)
        y[:, 3] = quat_log(quat_multiply(q_measured, quat_conj(past_q)))[:, 2]
        h = np.zeros((len(idx), 4, 15))
        h[:, 0, 0] = h[:, 1, 1] = h[:, 2, 2] = 1.0
        h[:, 0, 3] = h[:, 1, 4] = h[:, 2, 5] = -delay
        h[:, 3, _TH] = self.r_nb[idx, 2]
        r = np.empty((len(idx), 4))
        r[:, :3], r[:, 3] = var_p, var_yaw
        np.maximum(r, self._least_variance[idx], out=r)
        # The sample arrived at any time of the period: half a period old on average, with a variance of dt^2
        # / 12.
        r[:, :3] += self.v_n[idx] ** 2 * (self.dt**2 / 12)
        r[:, 3] += self.omega_b[idx, 2] ** 2 * (self.dt**2 / 12)
        self._gate_and_update(idx, y, h, r, has_yaw, now)

    def _gate_and_update(self, idx: Index, y: Array, h: Array, r: Array, has_yaw: Bool, now: float) -> None:
        """Test the innovations `y` (measured minus predicted) and correct the estimate with the accepted innovations.

        A rejected innovation gets a variance so large that it has no effect.

        A gate does not widen after a rejection, although the estimate becomes less certain. So after a jump
        the poses are rejected until they return to the expected place.
        """
        hp = h @ self.cov[idx]
        s_diag = np.einsum("mij,mij->mi", hp, h) + r
        self.innovation[idx], self.innovation_var[idx] = y, s_diag
        gate_var = np.minimum(s_diag, self._gate_var[idx])
        ratio = y * y / gate_var
        tested = np.empty((len(idx), 2))
        tested[:, 0], tested[:, 1] = ratio[:, :3].max(1), ratio[:, 3]
        tested /= self._gate_squared[idx]
        self.test_ratio[idx] = tested
        position_ratio, yaw_ratio = tested.T
        ctrl = self._ctrl[idx]
        consistent = position_ratio < 1.0
        use_xy, use_z = consistent & (ctrl & 1 > 0), consistent & (ctrl & 2 > 0)
        # A jump of the yaw alone is a flipped rigid body: do not follow it.
        use_yaw = has_yaw & consistent & (yaw_ratio < 1.0)
        rejected = ~consistent | (has_yaw & (yaw_ratio >= 1.0))
        self.rejected[idx] += rejected
        self._rejected_since[idx] = np.where(rejected, np.minimum(self._rejected_since[idx], now), np.inf)
        use, passed = np.empty_like(y, bool), np.empty_like(y, bool)
        use[:, 0] = use[:, 1] = use_xy
        use[:, 2], use[:, 3] = use_z, use_yaw
        passed[:, :3], passed[:, 3] = consistent[:, None], use_yaw
        gate_var[~has_yaw, 3] = self._gate_var[idx[~has_yaw], 3]
        self._gate_var[idx] = np.where(passed, np.inf, gate_var)
        self.last_xy[idx[use_xy]] = now
        self.last_z[idx[use_z]] = now
        self.last_yaw[idx[use_yaw]] = now
        self._update(idx, np.where(use, y, 0.0), h, np.where(use, r, _UNUSED_VARIANCE), hp)

    def _update(self, idx: Index, y: Array, h: Array, r: Array, hp: Array) -> None:
        s = hp @ h.transpose(0, 2, 1)
        np.einsum("mii->mi", s)[:] += r
        gain = np.linalg.solve(s, hp).transpose(0, 2, 1)
        dx = (gain @ y[:, :, None])[:, :, 0]
        cov = self.cov[idx] - gain @ hp
        self.cov[idx] = repaired(0.5 * (cov + cov.transpose(0, 2, 1)))
        self._inject(idx, dx)

    def _inject(self, idx: Index, dx: Array) -> None:
        """Correct the nominal state and the stored past states by the estimated error `dx`."""
        r_nb = self.r_nb[idx]
        dtheta_n = (r_nb @ dx[:, _TH, None])[:, :, 0]
        turn = quat_exp(dtheta_n)
        self.p_n[idx] += dx[:, _P]
        self.v_n[idx] += dx[:, _V]
        self.q_nb[idx] = quat_multiply(turn, self.q_nb[idx])
        self.gyro_bias[idx] += dx[:, _BG]
        limit = self.params["EKF2_ABL_LIM"][idx, None]
        self.accel_bias[idx] = np.minimum(np.maximum(self.accel_bias[idx] + dx[:, _BA], -limit), limit)
        self.r_nb[idx] = matrix_from_quat(self.q_nb[idx])
        depth = min(self._steps, int(np.max(self._delay_s[idx], initial=0.0) / self.dt) + 3)
        ages = np.arange(depth)
        at = ((self._steps - 1 - ages)[:, None] % self._ring, idx)
        self._ring_p[at] += dx[None, :, _P] - (ages * self.dt)[:, None, None] * dx[None, :, _V]
        self._ring_q[at] = quat_multiply(turn[None], self._ring_q[at])

    def fuse_baro(self, baro_alt_m: Array, now: float) -> None:
        """Fuse the barometer if vision gives no height, else estimate the barometer's offset.

        baro_alt_m: altitude, up [m], NaN for a failed sensor (V,)
        now: time since boot [s]
        """
        height = -self.p_n[:, 2]
        alive = np.isfinite(baro_alt_m)
        good = alive & self.aligned & (now - self.last_z < 0.2)
        first = good & ~self._baro_seen
        self._baro_offset[first] = (baro_alt_m - height)[first]
        self._baro_seen |= good
        share = min(1.0, (now - self._baro_at) / _BARO_OFFSET_S)
        self._baro_at = now
        self._baro_offset += np.where(good, share * (baro_alt_m - height - self._baro_offset), 0.0)
        after_s = np.minimum(_BARO_AFTER_S, 0.5 * self._timeout_s)
        lost = alive & self._baro_seen & (now - self.last_z > after_s) & (self.params["EKF2_BARO_CTRL"] > 0)
        if lost.any():
            idx = np.flatnonzero(lost)
            self._last_baro[idx] = now
            h = np.zeros((len(idx), 1, 15))
            h[:, 0, 2] = 1.0
            y = (self._baro_offset - baro_alt_m - self.p_n[:, 2])[idx, None]
            self._update(idx, y, h, np.full((len(idx), 1), 0.25), h @ self.cov[idx])

    def realign(self, idx: Index) -> None:
        """Mark vehicles as not aligned, so that the next vision sample aligns them again. IMU biases are kept. Use on the ground only."""
        self.aligned[idx] = False
        self.reset_counter[idx] += 1

    def _align(self, idx: Index, p_n: Array, q_nb: Array, var_p: Array, now: float) -> None:
        """Align the estimates of vehicles at rest: set tilt from gravity, heading and position from vision."""
        ok = np.isfinite(q_nb[:, 0])
        idx, p_n, q_nb, var_p = idx[ok], p_n[ok], q_nb[ok], var_p[ok]
        if not len(idx):
            return
        down_b = -self._accel_mean[idx]
        roll = np.arctan2(down_b[:, 1], down_b[:, 2])
        pitch = np.arctan2(-down_b[:, 0], np.hypot(down_b[:, 1], down_b[:, 2]))
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

    def _past(self, idx: Index, delay_s: Array) -> tuple[Array, Array]:
        """Return the position and attitude that were estimated `delay_s` [s] (m,) ago, interpolated from stored states."""
        age = delay_s / self.dt
        whole = np.floor(age).astype(int)
        part = (age - whole)[:, None]
        newer, older = (self._steps - 1 - whole) % self._ring, (self._steps - 2 - whole) % self._ring
        p = (1 - part) * self._ring_p[newer, idx] + part * self._ring_p[older, idx]
        q = (1 - part) * self._ring_q[newer, idx] + part * self._ring_q[older, idx]
        return p, q / np.sqrt((q * q).sum(1))[:, None]
