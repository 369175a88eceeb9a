"""Fusion of external vision: tests a pose against the estimate, and corrects the estimate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import rotations
from arena.kernels.arrays import floats, integers

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats
    from arena.kernels.error_covariance import ErrorCovariance
    from arena.kernels.strapdown import Strapdown

_INFINITE = float("inf")
_USE_XY, _USE_Z, _USE_YAW = 1, 2, 8
"""Bits of EKF2_EV_CTRL."""
_YAW = 3
"""Row of the yaw in arrays of innovations; the rows before are north, east, down."""


class VisionFusion:
    """Fusion of external vision poses with the estimates of V vehicles.

    control: EKF2_EV_CTRL (V,)
    delay_s: EKF2_EV_DELAY [s] (V,)
    least_variance: least variance of position [m2] and yaw [rad2] (V, 4)
    gate_squared: squared gates of position and yaw [-] (V, 2)
    gate_var: upper limit of the innovation variance in the gate test: the variance at the first rejection, infinite after an
        accepted innovation [m2] [rad2] (V, 4)
    rejected: output: number of rejected samples (V,)
    rejected_since: output: time of the first of the latest rejections in a row, infinite if accepted [s] (V,)
    test_ratio: output: squared innovation divided by its gate, for position and yaw [-] (V, 2)
    innovation, innovation_var: output: innovations of position [m] [NED] and yaw [rad], and their variances (V, 4)
    last_xy, last_z, last_yaw: output: time of the last fusion [s] (V,)
    """

    def __init__(
        self,
        state: Strapdown,
        covariance: ErrorCovariance,
        control: NDArray[np.int64],
        rejected: NDArray[np.int64],
    ) -> None:
        v = len(control)
        self.state, self.covariance = state, covariance
        self.control, self.rejected = integers(control), integers(rejected)
        self.delay_s, self.least_variance, self.gate_squared = floats(v), floats(v, 4), floats(v, 2)
        self.gate_var, self.rejected_since = floats(v, 4, fill=_INFINITE), floats(v, fill=_INFINITE)
        self.test_ratio, self.innovation = floats(v, 2), floats(v, 4)
        self.innovation_var = floats(v, 4, fill=1.0)
        self.last_xy, self.last_z, self.last_yaw = floats(v), floats(v), floats(v)
        self._jacobian, self._noise = floats(4, 15), floats(4)

    def fuse(self, i: int, pose: Floats, row: int, now: float) -> None:
        """Fuse one pose of vehicle i that was received in this IMU period.

        pose: position [m] [NED], attitude wxyz (NaN if not given), variances of position [m2] and yaw [rad2] (M, 11)
        row: row of the pose
        now: time since boot [s]
        """
        age_s = self.delay_s[i] + 0.5 * self.state.dt
        q_past = self.state.find_past(i, age_s)
        has_yaw = math.isfinite(pose[row, 3]) and self.control[i] & _USE_YAW != 0
        for k in range(3):
            self.innovation[i, k] = pose[row, k] - self.state.past_p[k]
        self.innovation[i, _YAW] = 0.0
        if has_yaw:
            q = (pose[row, 3], pose[row, 4], pose[row, 5], pose[row, 6])
            self.innovation[i, _YAW] = rotations.angle_about_z(
                rotations.product(q, rotations.conjugate(q_past))
            )
        self._set_measurement(i, pose, row, age_s)
        for k in range(4):
            variance = self.covariance.variance(i, self._jacobian, k)
            self.innovation_var[i, k] = variance + self._noise[k]
        self._gate(i, has_yaw, now)

    def _set_measurement(self, i: int, pose: Floats, row: int, age_s: float) -> None:
        """Set the Jacobian and the noise variance of the pose measurements of vehicle i.

        The four measurements are the position and the yaw.

        The pose arrived at an unknown time of the IMU period dt: on average half a period ago, with a variance of dt^2 / 12.
        """
        state, jitter = self.state, self.state.dt * self.state.dt / 12.0
        for k in range(3):
            self._jacobian[k, k], self._jacobian[k, 3 + k] = 1.0, -age_s
            self._jacobian[_YAW, 6 + k] = state.r_nb[i, 2, k]
            speed = state.v_n[i, k]
            self._noise[k] = max(pose[row, 7 + k], self.least_variance[i, k]) + speed * speed * jitter
        rate = state.omega_b[i, 2]
        self._noise[_YAW] = max(pose[row, 10], self.least_variance[i, _YAW]) + rate * rate * jitter

    def _gate(self, i: int, has_yaw: bool, now: float) -> None:
        """Test the innovations of vehicle i (gate test), and correct the estimate with the accepted ones.

        A gate does not widen after a rejection, although the estimate becomes less certain. So after a jump
        the poses are rejected until they return to the expected place.
        """
        position, yaw = 0.0, 0.0
        for k in range(3):
            position = max(position, self._ratio(i, k))
        position /= self.gate_squared[i, 0]
        yaw = self._ratio(i, _YAW) / self.gate_squared[i, 1]
        self.test_ratio[i, 0], self.test_ratio[i, 1] = position, yaw
        consistent = position < 1.0
        # A jump of the yaw alone is a flipped rigid body: do not follow it.
        use_yaw = has_yaw and consistent and yaw < 1.0
        if consistent and (yaw < 1.0 or not has_yaw):
            self.rejected_since[i] = _INFINITE
        else:
            self.rejected[i] += 1
            self.rejected_since[i] = min(self.rejected_since[i], now)
        for k in range(3):
            self._move_gate(i, k, consistent)
        if has_yaw:
            self._move_gate(i, _YAW, use_yaw)
        use_xy = consistent and self.control[i] & _USE_XY != 0
        use_z = consistent and self.control[i] & _USE_Z != 0
        self.last_xy[i] = now if use_xy else self.last_xy[i]
        self.last_z[i] = now if use_z else self.last_z[i]
        self.last_yaw[i] = now if use_yaw else self.last_yaw[i]
        self.covariance.begin()
        for k in range(4):
            use = use_yaw if k == _YAW else (use_z if k == 2 else use_xy)
            if use:
                self.covariance.correct(i, self._jacobian, k, self.innovation[i, k], self._noise[k])
        self.covariance.repair(i)
        past_states = int(self.delay_s[i] / self.state.dt) + 3
        self.state.correct(i, self.covariance.error, past_states)

    def _ratio(self, i: int, k: int) -> float:
        """Return the square of one innovation divided by its variance [-]; infinity if the innovation is NaN.

        k: index of the innovation

        The variance is limited to `gate_var`.
        """
        innovation = self.innovation[i, k]
        ratio = innovation * innovation / min(self.innovation_var[i, k], self.gate_var[i, k])
        return ratio if math.isfinite(ratio) else _INFINITE

    def _move_gate(self, i: int, k: int, passed: bool) -> None:
        """Limit the variance that the gate test uses for one innovation, so that rejected poses do not widen the gate.

        passed: the innovation was accepted

        While poses are rejected, the variance of the innovations grows. The stored variance is the limit.
        """
        self.gate_var[i, k] = _INFINITE if passed else min(self.innovation_var[i, k], self.gate_var[i, k])
