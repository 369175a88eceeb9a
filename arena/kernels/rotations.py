"""Functions for the attitude of one vehicle (quaternions, angles), with plain floats instead of arrays.

Quaternions are Hamilton, wxyz. `arena.geometry` explains the frames.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats

    Quaternion = tuple[float, float, float, float]
    Vector = tuple[float, float, float]


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the Hamilton product a * b of two quaternions.

    The product rotates a vector first by b, then by a.
    """
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def between(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return conj(a) * b: the rotation from attitude a to attitude b, in body axes of a."""
    aw, ax, ay, az = a
    return product((aw, -ax, -ay, -az), b)


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the quaternion of roll, pitch, yaw [rad], intrinsic z-y'-x'' (aviation)."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )


def yaw(q: Quaternion) -> float:
    """Return the yaw angle [rad] of an attitude."""
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def conjugate(q: Quaternion) -> Quaternion:
    """Return the conjugate of a quaternion.

    For a unit quaternion this is the inverse.
    """
    w, x, y, z = q
    return w, -x, -y, -z


def normalized(q: Quaternion) -> Quaternion:
    """Scale a quaternion to unit length."""
    w, x, y, z = q
    size = math.sqrt(w * w + x * x + y * y + z * z)
    return w / size, x / size, y / size, z / size


def from_rotation_vector(x: float, y: float, z: float) -> Quaternion:
    """Return the unit quaternion of a rotation vector (axis times angle) [rad]."""
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    share = 0.5 * math.sin(half) / max(half, 1e-100)  # exact at zero
    return math.cos(half), x * share, y * share, z * share


def angle_about_z(q: Quaternion) -> float:
    """Return the rotation about the z axis [rad]: the third element of the rotation vector of q.

    The angle of the rotation is at most pi.
    """
    w, x, y, z = q
    size = math.sqrt(x * x + y * y + z * z)
    if size < 1e-8:
        return -2.0 * z if w < 0.0 else 2.0 * z
    return (-z if w < 0.0 else z) * (2.0 * math.atan2(size, abs(w)) / size)


def store_matrix(matrices: Floats, i: int, q: Quaternion) -> None:
    """Store the rotation matrix of a quaternion in row i of an array (V, 3, 3).

    The matrix R has R @ v_b = q * v_b * conj(q).
    """
    w, x, y, z = q
    matrices[i, 0, 0] = w * w + x * x - y * y - z * z
    matrices[i, 1, 1] = w * w - x * x + y * y - z * z
    matrices[i, 2, 2] = w * w - x * x - y * y + z * z
    matrices[i, 0, 1], matrices[i, 1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    matrices[i, 0, 2], matrices[i, 2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    matrices[i, 1, 2], matrices[i, 2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)


def euler(q: Quaternion) -> Vector:
    """Return roll, pitch, yaw [rad] of an attitude, intrinsic z-y'-x'' (aviation)."""
    w, x, y, z = q
    roll = math.atan2(2.0 * (y * z + w * x), w * w - x * x - y * y + z * z)
    pitch = math.asin(min(max(-2.0 * (x * z - w * y), -1.0), 1.0))
    return roll, pitch, math.atan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z)


def rotated(q: Quaternion, v: Vector) -> Vector:
    """Rotate a vector by a quaternion: q * v * conj(q).

    Example: q_nb rotates v_b into v_n.
    """
    w, x, y, z = q
    vx, vy, vz = v
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + (y * tz - z * ty),
        vy + w * ty + (z * tx - x * tz),
        vz + w * tz + (x * ty - y * tx),
    )


def rotated_back(q: Quaternion, v: Vector) -> Vector:
    """Rotate a vector by the inverse of a quaternion: conj(q) * v * q.

    Example: q_nb rotates v_n into v_b.
    """
    w, x, y, z = q
    return rotated((w, -x, -y, -z), v)


def rotation_vector(a: Quaternion, b: Quaternion) -> Vector:
    """Return the rotation from attitude a to attitude b as axis times angle [rad], in body axes of a.

    The angle is at most pi.
    """
    w, x, y, z = between(a, b)
    size = math.sqrt(x * x + y * y + z * z)
    share = 2.0 if size < 1e-8 else 2.0 * math.atan2(size, abs(w)) / size
    if w < 0.0:
        share = -share
    return x * share, y * share, z * share


def slerp(a: Quaternion, b: Quaternion, fraction: float) -> Quaternion:
    """Interpolate at constant rate from attitude a (fraction 0) to b (fraction 1), along the shorter arc."""
    x, y, z = rotation_vector(a, b)
    return product(a, from_rotation_vector(fraction * x, fraction * y, fraction * z))
