"""Rotations of one vehicle in plain floats. Quaternions are Hamilton, wxyz; `arena.geometry` explains the frames."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    Quaternion = tuple[float, float, float, float]


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the Hamilton product a * b. The product rotates a vector first by b, then by a."""
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
