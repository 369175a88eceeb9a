"""Motion of rigid bodies in free flight (no contacts), bit for bit as pybullet computes it.

pybullet has a world with z up (`w`) and body axes FLU. The state is kept in these axes, because another order of sums
would round differently; the outputs are in NED and FRD. One step of duration h:

1. Force, torque and the gyroscopic torque -omega x (I omega) are those at the begin of the step.
2. The velocities change by the acceleration times h (semi-implicit Euler method).
3. The position moves with the new velocity.
4. The attitude turns about the new angular velocity omega by the exact rotation of angle |omega| h.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.constants import GRAVITY_M_S2
from arena.kernels import limits
from arena.kernels.arrays import flags, floats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats

    Triple = tuple[float, float, float]
    Nine = tuple[float, float, float, float, float, float, float, float, float]

_G = GRAVITY_M_S2
_MOST_SPEED = 100.0  # pybullet's limit of each component of the velocities [m/s], [rad/s]
_MOST_TURN = 0.25 * math.pi  # a larger rotation in one step is limited to this angle [rad]
_SMALL_RATE = 0.001  # sin(x) / x is a series below this rate [rad/s]
_SERIES = 0.020833333333  # 1 / 48, with pybullet's digits
_HALF_ROOT = math.sqrt(0.5)


class FreeFlight:
    """Motion of V rigid bodies in free flight, computed as pybullet does.

    `step` moves only the bodies in free flight, which touch nothing.

    step_s: duration of a step [s]
    free: input: True for the bodies that `step` moves; the caller moves the others (V,)
    mass, inertia: mass [kg] (V,) and moments of inertia about the body axes [kg m2] (V, 3)
    place_w, quat, speed_w, rate_w: state: position [m], attitude xyzw (body FLU -> world), velocity [m/s] and angular
        velocity [rad/s], in the world with z up (V, 3), (V, 4), (V, 3), (V, 3)
    wind_n: input: motion of the air [m/s] [NED] (V, 3)
    force_b, torque_b: input: wrench of the next step [N], [N m] [FRD] (V, 3)
    p_n, v_n: output: position [m] and velocity [m/s] [NED] (V, 3)
    q_nb, r_nb, omega_b: output: attitude wxyz (V, 4), its matrix (V, 3, 3), body rates [rad/s] [FRD] (V, 3)
    air_b, height: output: velocity relative to the air [m/s] [FRD] (V, 3), height above the floor [m] (V,)
    accel_b: output: sum of the specific forces of all steps since `begin` [m/s2] [FRD] (V, 3)
    mean_accel_b: output of `average`: their mean [m/s2] [FRD] (V, 3)
    """

    def __init__(self, free: NDArray[np.bool_], step_s: float) -> None:
        v, self.step_s, self.free = len(free), step_s, flags(free)
        self.mass, self.inertia = floats(v), floats(v, 3)
        self.place_w, self.speed_w, self.rate_w = floats(v, 3), floats(v, 3), floats(v, 3)
        self.quat, self._r_wf = floats(v, 4), floats(v, 3, 3)
        self.wind_n, self.force_b, self.torque_b = floats(v, 3), floats(v, 3), floats(v, 3)
        self.p_n, self.v_n, self.omega_b = floats(v, 3), floats(v, 3), floats(v, 3)
        self.q_nb, self.r_nb = floats(v, 4), floats(v, 3, 3)
        self.air_b, self.height, self.accel_b = floats(v, 3), floats(v), floats(v, 3)
        self.mean_accel_b = floats(v, 3)

    def begin(self) -> None:
        """Prepare a sensor period: reset the sum of specific forces, and apply the new wind."""
        for i in range(len(self.free)):
            for k in range(3):
                self.accel_b[i, k] = 0.0
            self._set_air(i)

    def step(self) -> None:
        """Move the bodies in free flight by one step.

        The caller moves the other bodies, and calls `finish` after that.
        """
        for i in range(len(self.free)):
            if self.free[i]:
                self._accelerate(i)
                self._move(i)

    def finish(self) -> None:
        """Update the outputs of all bodies after a step.

        The specific force of the step is added to `accel_b`. The other outputs are computed from the new
        state.
        """
        for i in range(len(self.free)):
            h, speed, before = self.step_s, self.speed_w, self.v_n
            north, east = (speed[i, 1] - before[i, 0]) / h, (speed[i, 0] - before[i, 1]) / h
            down = (-speed[i, 2] - before[i, 2]) / h - _G
            x, y, z = rotated_back(matrix_of(self.r_nb, i), (north, east, down))
            self.accel_b[i, 0] += x
            self.accel_b[i, 1] += y
            self.accel_b[i, 2] += z
            self.publish(i)
            self._set_air(i)

    def average(self, steps: int) -> None:
        """Compute `mean_accel_b` from the sum of the specific forces. steps: number of steps since `begin`"""
        for i in range(len(self.free)):
            for k in range(3):
                self.mean_accel_b[i, k] = self.accel_b[i, k] / steps

    def publish(self, i: int) -> None:
        """Compute the outputs of body i (in NED and FRD) from its state in pybullet's axes."""
        place, speed, rate, r = self.place_w, self.speed_w, self.rate_w, self._r_wf
        self._set_matrix(i)
        self.p_n[i, 0], self.p_n[i, 1], self.p_n[i, 2] = place[i, 1], place[i, 0], -place[i, 2]
        self.v_n[i, 0], self.v_n[i, 1], self.v_n[i, 2] = speed[i, 1], speed[i, 0], -speed[i, 2]
        self.height[i] = place[i, 2]
        for k in range(3):
            sign = 1.0 if k == 0 else -1.0  # FRD from FLU
            self.r_nb[i, 0, k], self.r_nb[i, 1, k] = sign * r[i, 1, k], sign * r[i, 0, k]
            self.r_nb[i, 2, k] = -sign * r[i, 2, k]
        self.omega_b[i, 0], self.omega_b[i, 1], self.omega_b[i, 2] = rotated_back(
            matrix_of(self.r_nb, i), (rate[i, 1], rate[i, 0], -rate[i, 2])
        )
        x, y, z, w = self.quat[i, 0], self.quat[i, 1], self.quat[i, 2], self.quat[i, 3]
        self.q_nb[i, 0], self.q_nb[i, 1] = _HALF_ROOT * (w + z), _HALF_ROOT * (x + y)
        self.q_nb[i, 2], self.q_nb[i, 3] = _HALF_ROOT * (x - y), _HALF_ROOT * (w - z)

    def _accelerate(self, i: int) -> None:
        """Apply wrench, gyroscopic torque and gravity to the velocities of body i for one step.

        The wrench and the velocities are rotated to the world and back, as in pybullet. This changes only the rounding.
        """
        m, f, t, r = self.mass[i], self.force_b, self.torque_b, matrix_of(self._r_wf, i)
        push = rotated(r, (f[i, 0], -f[i, 1], -f[i, 2]))
        push = rotated_back(r, (push[0], push[1], push[2] - _G * m))
        twist = rotated_back(r, rotated(r, (t[i, 0], -t[i, 1], -t[i, 2])))
        turn = rotated_back(r, (self.rate_w[i, 0], self.rate_w[i, 1], self.rate_w[i, 2]))
        move = rotated_back(r, (self.speed_w[i, 0], self.speed_w[i, 1], self.speed_w[i, 2]))
        jx, jy, jz = self.inertia[i, 0], self.inertia[i, 1], self.inertia[i, 2]
        gyro = cross(turn, (jx * turn[0], jy * turn[1], jz * turn[2]))
        spin_up = rotated(
            r, ((twist[0] - gyro[0]) / jx, (twist[1] - gyro[1]) / jy, (twist[2] - gyro[2]) / jz)
        )
        self._add(i, self.rate_w, spin_up)
        swing, per_mass = cross(turn, move), 1.0 / m
        speed_up = rotated(
            r,
            (
                (push[0] - m * swing[0]) * per_mass + swing[0],
                (push[1] - m * swing[1]) * per_mass + swing[1],
                (push[2] - m * swing[2]) * per_mass + swing[2],
            ),
        )
        self._add(i, self.speed_w, speed_up)

    def _add(self, i: int, velocity: Floats, accel: Triple) -> None:
        """Apply an acceleration to the velocity of body i for the duration of one step.

        velocity: velocities or angular velocities of all bodies, in the world with z up (V, 3)
        accel: acceleration or angular acceleration, in the same axes
        """
        velocity[i, 0] = limits.within(velocity[i, 0] + accel[0] * self.step_s, -_MOST_SPEED, _MOST_SPEED)
        velocity[i, 1] = limits.within(velocity[i, 1] + accel[1] * self.step_s, -_MOST_SPEED, _MOST_SPEED)
        velocity[i, 2] = limits.within(velocity[i, 2] + accel[2] * self.step_s, -_MOST_SPEED, _MOST_SPEED)

    def _move(self, i: int) -> None:
        """Move and rotate body i for one step at its velocity and angular velocity."""
        h, rate, q = self.step_s, self.rate_w, self.quat
        for k in range(3):
            self.place_w[i, k] += h * self.speed_w[i, k]
        size = math.sqrt(rate[i, 0] * rate[i, 0] + rate[i, 1] * rate[i, 1] + rate[i, 2] * rate[i, 2])
        if size * h > _MOST_TURN:
            size = _MOST_TURN / h
        share = sine_share(size, h)
        a, b, c, d = rate[i, 0] * share, rate[i, 1] * share, rate[i, 2] * share, math.cos(size * h * 0.5)
        x, y, z, w = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        q[i, 0], q[i, 1] = w * a + x * d - y * c + z * b, w * b + y * d - z * a + x * c
        q[i, 2], q[i, 3] = w * c + z * d - x * b + y * a, w * d - x * a - y * b - z * c
        x, y, z, w = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
        for k in range(4):
            q[i, k] *= scale

    def _set_air(self, i: int) -> None:
        """Compute the velocity of body i relative to the air, in body axes."""
        v, wind = self.v_n, self.wind_n
        self.air_b[i, 0], self.air_b[i, 1], self.air_b[i, 2] = rotated_back(
            matrix_of(self.r_nb, i),
            (v[i, 0] - wind[i, 0], v[i, 1] - wind[i, 1], v[i, 2] - wind[i, 2]),
        )

    def _set_matrix(self, i: int) -> None:
        """Compute the rotation matrix of body i from its quaternion."""
        r, x, y, z, w = self._r_wf, self.quat[i, 0], self.quat[i, 1], self.quat[i, 2], self.quat[i, 3]
        scale = 2.0 / (x * x + y * y + z * z + w * w)
        xs, ys, zs = x * scale, y * scale, z * scale
        r[i, 0, 0], r[i, 0, 1], r[i, 0, 2] = 1.0 - (y * ys + z * zs), x * ys - w * zs, x * zs + w * ys
        r[i, 1, 0], r[i, 1, 1], r[i, 1, 2] = x * ys + w * zs, 1.0 - (x * xs + z * zs), y * zs - w * xs
        r[i, 2, 0], r[i, 2, 1], r[i, 2, 2] = x * zs - w * ys, y * zs + w * xs, 1.0 - (x * xs + y * ys)


def matrix_of(matrices: Floats, i: int) -> Nine:
    """Return the elements of matrix i, row after row. They are read once for several vectors. matrices: (V, 3, 3)"""
    m = matrices
    return (
        m[i, 0, 0],
        m[i, 0, 1],
        m[i, 0, 2],
        m[i, 1, 0],
        m[i, 1, 1],
        m[i, 1, 2],
        m[i, 2, 0],
        m[i, 2, 1],
        m[i, 2, 2],
    )


def rotated(r: Nine, v: Triple) -> Triple:
    """Return a vector that is rotated by a matrix: r * v. r: (3, 3), row after row."""
    return (
        r[0] * v[0] + r[1] * v[1] + r[2] * v[2],
        r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
        r[6] * v[0] + r[7] * v[1] + r[8] * v[2],
    )


def rotated_back(r: Nine, v: Triple) -> Triple:
    """Return a vector that is rotated back: the transpose of r, times v. r: (3, 3), row after row."""
    return (
        r[0] * v[0] + r[3] * v[1] + r[6] * v[2],
        r[1] * v[0] + r[4] * v[1] + r[7] * v[2],
        r[2] * v[0] + r[5] * v[1] + r[8] * v[2],
    )


def cross(a: Triple, b: Triple) -> Triple:
    """Return the cross product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def sine_share(rate: float, h: float) -> float:
    """Return sin(rate * h / 2) / rate [s], with which an angular velocity is converted to a quaternion.

    An angular velocity times this factor is the vector part of the quaternion of its rotation.

    rate: size of the angular velocity [rad/s]
    h: duration of the rotation [s]
    """
    if rate < _SMALL_RATE:
        return 0.5 * h - (h * h * h) * _SERIES * rate * rate
    return math.sin(0.5 * rate * h) / rate
