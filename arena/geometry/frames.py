"""Turning vectors and attitudes from one frame into another: n <-> w, b <-> f. See the package docstring."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from arena.geometry.quaternion import Array, quat_multiply

_H = np.sqrt(0.5)
# w: x east, y north, z up. n from w swaps the horizontal axes and turns z: half a turn about (1, 1, 0).
_Q_NW_WXYZ = np.array([0.0, _H, _H, 0.0])
# f: forward, left, up. b from f is half a turn about the forward axis.
_Q_BF_WXYZ = np.array([0.0, 1.0, 0.0, 0.0])


def ned_from_world(v_w: ArrayLike) -> Array:
    """v_w: any vector in z-up world axes (..., 3) -> the same vector in NED: (y, x, -z)."""
    v_w = np.asarray(v_w, float)
    return np.stack([v_w[..., 1], v_w[..., 0], -v_w[..., 2]], axis=-1)


def world_from_ned(v_n: ArrayLike) -> Array:
    """The inverse, which is the same swap (..., 3)."""
    return ned_from_world(v_n)


def frd_from_flu(v_f: ArrayLike) -> Array:
    """v_f: forward, left, up (..., 3) -> forward, right, down. It is its own inverse."""
    return np.asarray(v_f, float) * (1.0, -1.0, -1.0)


def q_nb_from_q_wf(q_wf: ArrayLike) -> Array:
    """Attitude as motion capture and pybullet give it (FLU in z-up world) -> FRD in NED; wxyz (..., 4)."""
    return quat_multiply(quat_multiply(_Q_NW_WXYZ, q_wf), _Q_BF_WXYZ * (1, -1, -1, -1))


def q_wf_from_q_nb(q_nb: ArrayLike) -> Array:
    """The inverse of q_nb_from_q_wf; wxyz (..., 4)."""
    return quat_multiply(quat_multiply(_Q_NW_WXYZ * (1, -1, -1, -1), q_nb), _Q_BF_WXYZ)


def wxyz_from_xyzw(quat_xyzw: ArrayLike) -> Array:
    """Scalar-last (pybullet, NatNet, VRPN) -> scalar-first; (..., 4)."""
    return np.roll(np.asarray(quat_xyzw, float), 1, axis=-1)


def xyzw_from_wxyz(quat_wxyz: ArrayLike) -> Array:
    """Scalar-first -> scalar-last; (..., 4)."""
    return np.roll(np.asarray(quat_wxyz, float), -1, axis=-1)
