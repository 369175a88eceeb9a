"""Unit Hamilton quaternions (scalar first, wxyz) in arrays of shape (..., 4).

The module `frames` explains the frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arena.portable_math import arcsin, arctan2, cos, product, sin

Array = NDArray[np.float64]

_TINY = 1e-8

# Row 4 i + j: what the product of a's i-th and b's j-th component adds to w, x, y, z (Hamilton: ij = k).
_HAMILTON = np.zeros((16, 4))
for _i, _j, _k, _sign in (
    (0, 0, 0, 1),
    (1, 1, 0, -1),
    (2, 2, 0, -1),
    (3, 3, 0, -1),
    (0, 1, 1, 1),
    (1, 0, 1, 1),
    (2, 3, 1, 1),
    (3, 2, 1, -1),
    (0, 2, 2, 1),
    (1, 3, 2, -1),
    (2, 0, 2, 1),
    (3, 1, 2, 1),
    (0, 3, 3, 1),
    (1, 2, 3, 1),
    (2, 1, 3, -1),
    (3, 0, 3, 1),
):
    _HAMILTON[4 * _i + _j, _k] = _sign
# The same for conj(a) * b, and for the rotation matrix of one quaternion, from the products of its own components: column k
# of the matrix is q * e_k * conj(q).
_CONJ = np.array([1.0, -1.0, -1.0, -1.0])
_H = _HAMILTON.reshape(4, 4, 4)
_BETWEEN = (_H * _CONJ[:, None, None]).reshape(16, 4)
_MATRIX = np.einsum("akm,b,mbl->ablk", _H[:, 1:], _CONJ, _H[:, :, 1:]).reshape(16, 9)
# From the products of cosine or sine of half the yaw, half the pitch and half the roll: q = q_yaw * q_pitch * q_roll.
_EULER = np.einsum("ypm,mrk->yprk", _H[[0, 3]][:, [0, 2]], _H[:, [0, 1]]).reshape(8, 4)


def wrap_pi(angle: ArrayLike) -> Array:
    """Return an angle [rad] (...) wrapped to [-pi, pi)."""
    return np.asarray((np.asarray(angle, float) + np.pi) % (2.0 * np.pi) - np.pi)


def quat_multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the Hamilton product a * b [-] wxyz (..., 4).

    The product rotates a vector first by b, then by a.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    # All sixteen products at once, then their signed sums: three numpy calls instead of thirty.
    products = a[..., :, None] * b[..., None, :]
    return product(products.reshape(*products.shape[:-2], 16), _HAMILTON)


def quat_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Return conj(a) * b [-] wxyz (..., 4): the rotation from attitude a to attitude b, in body axes of a."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    products = a[..., :, None] * b[..., None, :]
    return product(products.reshape(*products.shape[:-2], 16), _BETWEEN)


def quat_conj(q: ArrayLike) -> Array:
    """Return the conjugate of a quaternion [-] wxyz (..., 4).

    For a unit quaternion this is the inverse.
    """
    return np.asarray(np.asarray(q, float) * _CONJ)


def quat_normalize(q: ArrayLike) -> Array:
    """Scale a quaternion to unit length [-] wxyz (..., 4).

    Raises ValueError if its norm is zero or not finite.
    """
    q = np.asarray(q, float)
    norm = np.sqrt((q * q).sum(-1, keepdims=True))
    if not np.all(np.isfinite(norm)) or np.any(norm < _TINY):
        raise ValueError(f"got a quaternion of norm {norm.ravel()}, expected a finite norm above 0")
    return np.asarray(q / norm)


def matrix_from_quat(q: ArrayLike) -> Array:
    """Return the rotation matrix R of a quaternion q [-] (..., 3, 3): R @ v_b = q * v_b * conj(q)."""
    q = np.asarray(q, float)
    shape = q.shape[:-1]
    products = (q[..., :, None] * q[..., None, :]).reshape(*shape, 16)
    return product(products, _MATRIX).reshape(*shape, 3, 3)


def quat_from_matrix(m: ArrayLike) -> Array:
    """Return the quaternion of a rotation matrix [-] wxyz (..., 4), with w >= 0.

    The largest component is computed first (Shepperd, 1978), which is the most accurate order.
    """
    m = np.asarray(m, float)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    # Four times the outer product q q^T; the row of the largest diagonal entry is q up to scale and sign.
    k = np.empty((*m.shape[:-2], 4, 4))
    k[..., 0, 0], k[..., 1, 1] = 1 + xx + yy + zz, 1 + xx - yy - zz
    k[..., 2, 2], k[..., 3, 3] = 1 - xx + yy - zz, 1 - xx - yy + zz
    k[..., 0, 1] = k[..., 1, 0] = m[..., 2, 1] - m[..., 1, 2]
    k[..., 0, 2] = k[..., 2, 0] = m[..., 0, 2] - m[..., 2, 0]
    k[..., 0, 3] = k[..., 3, 0] = m[..., 1, 0] - m[..., 0, 1]
    k[..., 1, 2] = k[..., 2, 1] = m[..., 1, 0] + m[..., 0, 1]
    k[..., 1, 3] = k[..., 3, 1] = m[..., 0, 2] + m[..., 2, 0]
    k[..., 2, 3] = k[..., 3, 2] = m[..., 2, 1] + m[..., 1, 2]
    best = np.argmax(np.diagonal(k, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(k, best[..., None, None], axis=-2)[..., 0, :]
    q = q * np.where(q[..., :1] < 0, -1.0, 1.0)
    return quat_normalize(q)


def quat_rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Rotate vectors v (..., 3) by quaternions q (..., 4): return q * v * conj(q).

    Example: q_nb rotates v_b into v_n.
    """
    q, v = np.asarray(q, float), np.asarray(v, float)
    u, w = q[..., 1:], q[..., :1]
    t = 2.0 * _cross(u, v)
    return np.asarray(v + w * t + _cross(u, t))


def _cross(a: Array, b: Array) -> Array:
    """Return the cross product of two arrays of vectors (..., 3).

    For small arrays this is about ten times faster than np.cross.
    """
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def quat_exp(rotation_vector: ArrayLike) -> Array:
    """Return the unit quaternion wxyz (..., 4) of a rotation vector (axis times angle) [rad] (..., 3)."""
    v = np.asarray(rotation_vector, float)
    half = 0.5 * np.sqrt((v * v).sum(-1, keepdims=True))
    q = np.empty((*v.shape[:-1], 4))
    q[..., :1] = cos(half)
    half = np.maximum(half, 1e-100)
    q[..., 1:] = v * (0.5 * sin(half) / half)  # sin(half) / angle, exact at zero
    return q


def quat_log(q: ArrayLike) -> Array:
    """Return the rotation vector (axis times angle) of a quaternion [rad] (..., 3).

    Its angle is at most pi.
    """
    q = np.asarray(q, float)
    q = q * np.where(q[..., :1] < 0, -1.0, 1.0)
    v = q[..., 1:]
    norm = np.sqrt((v * v).sum(-1, keepdims=True))
    angle = 2.0 * arctan2(norm, q[..., :1])
    small = norm < _TINY
    return np.asarray(v * np.where(small, 2.0, angle / np.where(small, 1.0, norm)))


def quat_slerp(a: ArrayLike, b: ArrayLike, fraction: ArrayLike) -> Array:
    """Interpolate at constant rate from attitude a (fraction 0) to b (fraction 1) [-] wxyz (..., 4).

    Takes the shorter way, of at most pi.
    """
    step = quat_log(quat_multiply(quat_conj(a), b))
    return quat_multiply(a, quat_exp(np.asarray(fraction, float)[..., None] * step))


def quat_from_euler(rpy: ArrayLike) -> Array:
    """Return the quaternion (..., 4) of roll, pitch, yaw [rad] (..., 3), intrinsic z-y'-x'' (aviation)."""
    half = 0.5 * np.asarray(rpy, float)
    cs = np.empty((*half.shape, 2))
    cs[..., 0] = cos(half)
    cs[..., 1] = sin(half)
    products = cs[..., 2, :, None, None] * cs[..., 1, None, :, None] * cs[..., 0, None, None, :]
    return product(products.reshape(*half.shape[:-1], 8), _EULER)


def euler_from_quat(q: ArrayLike) -> Array:
    """Return roll, pitch, yaw [rad] (..., 3) of a quaternion wxyz (..., 4), intrinsic z-y'-x''."""
    return euler_from_matrix(matrix_from_quat(q))


def euler_from_matrix(m: ArrayLike) -> Array:
    """Return roll, pitch, yaw [rad] (..., 3) of a rotation matrix (..., 3, 3), intrinsic z-y'-x''."""
    m = np.asarray(m, float)
    out = np.empty(m.shape[:-1])
    out[..., 0] = arctan2(m[..., 2, 1], m[..., 2, 2])
    out[..., 1] = arcsin(np.minimum(np.maximum(-m[..., 2, 0], -1.0), 1.0))
    out[..., 2] = arctan2(m[..., 1, 0], m[..., 0, 0])
    return out


def yaw_from_quat(q: ArrayLike) -> Array:
    """Return the yaw angle [rad] (...) of a quaternion wxyz (..., 4)."""
    q = np.asarray(q, float)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return np.asarray(arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
