"""Strapdown navigation: predicts position, velocity and attitude from the inertial sensors.

It also keeps past states.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.constants import GRAVITY_M_S2
from arena.kernels import limits, rotations
from arena.kernels.arrays import flags, floats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats

_G = GRAVITY_M_S2


class Strapdown:
    """Predicted position, velocity, attitude and sensor biases of V vehicles.

    dt: IMU period [s]
    mean_share: share of a new sample in the mean specific force 0..1
    aligned: input: True if the initial attitude is set; other vehicles do not move (V,)
    sensed_accel_b, sensed_gyro_b: input: specific force [m/s2] and body rates [rad/s] [FRD] (V, 3)
    bias_limit: limit of the accelerometer bias [m/s2] (V,)
    p_n, v_n, a_n: position [m], velocity [m/s], acceleration [m/s2] [NED] (V, 3)
    q_nb, r_nb: attitude wxyz (V, 4) and its rotation matrix (V, 3, 3)
    omega_b, force_b: body rates [rad/s] and specific force [m/s2] without bias [FRD] (V, 3)
    gyro_bias, accel_bias: biases [rad/s], [m/s2] [FRD] (V, 3)
    accel_mean: mean specific force [m/s2] [FRD] (V, 3)
    ring_p, ring_q: past positions (N, V, 3) and attitudes (N, V, 4); the state of step k is in row k modulo N
    steps: number of steps
    past_p: output of `find_past` [m] [NED] (3,)
    """

    def __init__(self, aligned: NDArray[np.bool_], dt: float, mean_share: float, past_states: int) -> None:
        v, self.dt, self.mean_share = len(aligned), dt, mean_share
        self.aligned, self.bias_limit = flags(aligned), floats(v)
        self.sensed_accel_b, self.sensed_gyro_b = floats(v, 3), floats(v, 3)
        self.p_n, self.v_n, self.a_n = floats(v, 3), floats(v, 3), floats(v, 3)
        self.q_nb, self.r_nb = floats(v, 4), floats(v, 3, 3)
        self.omega_b, self.force_b = floats(v, 3), floats(v, 3)
        self.gyro_bias, self.accel_bias, self.accel_mean = floats(v, 3), floats(v, 3), floats(v, 3)
        self.ring_p, self.ring_q = floats(past_states, v, 3), floats(past_states, v, 4)
        self.steps = 0
        self.past_p = floats(3)

    def step(self) -> None:
        """Advance all vehicles by one IMU period."""
        slot = self.steps % len(self.ring_p)
        for i in range(len(self.aligned)):
            self._turn(i)
            self._move(i)
            for k in range(3):
                self.ring_p[slot, i, k] = self.p_n[i, k]
            for k in range(4):
                self.ring_q[slot, i, k] = self.q_nb[i, k]
        self.steps += 1

    def _turn(self, i: int) -> None:
        """Advance the attitude of vehicle i by one IMU period, and rotate its specific force to NED.

        The gyroscope measures the rates at the end of the period, the accelerometer the mean over the period. So the
        rates of both ends are averaged, and the specific force is rotated by the mean of both attitudes.
        """
        x = y = z = 0.0
        for k in range(3):
            accel = self.sensed_accel_b[i, k]
            self.accel_mean[i, k] += self.mean_share * (accel - self.accel_mean[i, k])
            self.force_b[i, k] = accel - self.accel_bias[i, k]
        x, y, z = self._mean_rate(i, 0), self._mean_rate(i, 1), self._mean_rate(i, 2)
        turn = rotations.from_rotation_vector(x * self.dt, y * self.dt, z * self.dt)
        before, q = self._force_n(i), self.q_nb
        self._set_attitude(
            i, rotations.normalized(rotations.product((q[i, 0], q[i, 1], q[i, 2], q[i, 3]), turn))
        )
        after = self._force_n(i)
        self.a_n[i, 0] = 0.5 * before[0] + 0.5 * after[0]
        self.a_n[i, 1] = 0.5 * before[1] + 0.5 * after[1]
        self.a_n[i, 2] = 0.5 * before[2] + 0.5 * after[2]

    def _mean_rate(self, i: int, axis: int) -> float:
        """Return the mean body rate of the last period about one axis [rad/s].

        The rate at the end of the period is stored.
        """
        before, after = self.omega_b[i, axis], self.sensed_gyro_b[i, axis] - self.gyro_bias[i, axis]
        self.omega_b[i, axis] = after
        return 0.5 * (before + after)

    def _force_n(self, i: int) -> rotations.Vector:
        """Return the specific force, rotated to NED by the present attitude [m/s2]."""
        r, x, y, z = self.r_nb, self.force_b[i, 0], self.force_b[i, 1], self.force_b[i, 2]
        return (
            r[i, 0, 0] * x + r[i, 0, 1] * y + r[i, 0, 2] * z,
            r[i, 1, 0] * x + r[i, 1, 1] * y + r[i, 1, 2] * z,
            r[i, 2, 0] * x + r[i, 2, 1] * y + r[i, 2, 2] * z,
        )

    def _set_attitude(self, i: int, q: rotations.Quaternion) -> None:
        self.q_nb[i, 0], self.q_nb[i, 1], self.q_nb[i, 2], self.q_nb[i, 3] = q
        rotations.store_matrix(self.r_nb, i, q)

    def _move(self, i: int) -> None:
        """Advance velocity and position of vehicle i by one IMU period.

        The velocity changes only after the initial attitude is set.
        """
        self.a_n[i, 2] += _G
        for k in range(3):
            change = self.a_n[i, k] * self.dt if self.aligned[i] else 0.0
            self.p_n[i, k] += (self.v_n[i, k] + 0.5 * change) * self.dt
            self.v_n[i, k] += change

    def find_past(self, i: int, age_s: float) -> rotations.Quaternion:
        """Return the attitude of vehicle i at a past time, and store its position at that time in `past_p`.

        Both are interpolated. age_s: time before now [s]
        """
        periods = math.floor(age_s / self.dt)
        part, whole = age_s / self.dt - periods, int(periods)
        size = len(self.ring_p)
        newer, older = (self.steps - 1 - whole + size) % size, (self.steps - 2 - whole + size) % size
        for k in range(3):
            self.past_p[k] = (1.0 - part) * self.ring_p[newer, i, k] + part * self.ring_p[older, i, k]
        a, b, q = 1.0 - part, part, self.ring_q
        return rotations.normalized(
            (
                a * q[newer, i, 0] + b * q[older, i, 0],
                a * q[newer, i, 1] + b * q[older, i, 1],
                a * q[newer, i, 2] + b * q[older, i, 2],
                a * q[newer, i, 3] + b * q[older, i, 3],
            )
        )

    def correct(self, i: int, error: Floats, past_states: int) -> None:
        """Correct the present state and the newest past states of vehicle i by an estimated error.

        error: estimated error: position, velocity, attitude [rad] [FRD], gyroscope and accelerometer bias (15,)
        past_states: number of past states to correct; they were estimated with the same error
        """
        x, y, z, r, q = error[6], error[7], error[8], self.r_nb, self.q_nb
        turn = rotations.from_rotation_vector(
            r[i, 0, 0] * x + r[i, 0, 1] * y + r[i, 0, 2] * z,
            r[i, 1, 0] * x + r[i, 1, 1] * y + r[i, 1, 2] * z,
            r[i, 2, 0] * x + r[i, 2, 1] * y + r[i, 2, 2] * z,
        )
        most = self.bias_limit[i]
        for k in range(3):
            self.p_n[i, k] += error[k]
            self.v_n[i, k] += error[3 + k]
            self.gyro_bias[i, k] += error[9 + k]
            self.accel_bias[i, k] = limits.within(self.accel_bias[i, k] + error[12 + k], -most, most)
        self._set_attitude(i, rotations.product(turn, (q[i, 0], q[i, 1], q[i, 2], q[i, 3])))
        size, q_past = len(self.ring_p), self.ring_q
        for age in range(min(past_states, self.steps, size)):
            at = (self.steps - 1 - age) % size
            for k in range(3):
                self.ring_p[at, i, k] += error[k] - age * self.dt * error[3 + k]
            turned = rotations.product(
                turn, (q_past[at, i, 0], q_past[at, i, 1], q_past[at, i, 2], q_past[at, i, 3])
            )
            q_past[at, i, 0], q_past[at, i, 1], q_past[at, i, 2], q_past[at, i, 3] = turned
