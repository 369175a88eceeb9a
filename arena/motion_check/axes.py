"""Rotation between the axes of a captured body and those of the vehicle's inertial sensors. Pure.

It is computed from rotation rates and gravity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from arena.geometry import Array, quat_from_matrix, quat_log

_RANK = 0.1  # less information about a second axis does not determine the rotation
_ALONG = 0.94  # cosine of the largest angle between a rotation and a main axis that names it


@dataclass(frozen=True, kw_only=True)
class Axes:
    """Rotation of a captured body relative to the vehicle's inertial sensors, from `fit_axes`.

    turned_rad: vector of the rotation from captured body axes to the axes of the sensors [rad] [FRD] (3,)
    agreement: agreement of captured and measured vectors after this rotation, -1 to 1 [-]
    mirrored: a reflection fits better than every rotation
    """

    turned_rad: Array
    agreement: float
    mirrored: bool

    @property
    def turned_deg(self) -> float:
        """Angle between the axes of the captured body and the axes of the inertial sensors [deg]."""
        return math.degrees(float(np.linalg.norm(self.turned_rad)))


def fit_axes(rates: tuple[Array, Array], down: tuple[Array, Array]) -> Axes | None:
    """Return the rotation between the axes of the rigid body in motion capture and those of the inertial sensors.

    It is the rotation with which captured rotation rates and gravity agree best with the measured values. Return
    None if the motion was too small to determine it.

    rates, down: captured and measured rotation rates [rad/s] [FRD] (N, 3), directions down [-] [FRD] (M, 3),
    at the same times

    The rotation is that of Kabsch (1976). A rate is an axial vector: a reflection also reverses it. Gravity
    is a polar vector. A reflection therefore is a rotation of the rates that fits the reversed gravity.
    """
    turn, fall = _cross_correlation(*rates), _cross_correlation(*down)
    proper, mirrored = _rotation(turn + fall), _rotation(turn - fall)
    if proper is None or mirrored is None:
        return None
    better = mirrored[1] > proper[1]
    rotation, agreement = mirrored if better else proper
    return Axes(turned_rad=quat_log(quat_from_matrix(rotation)), agreement=agreement / 2.0, mirrored=better)


def turn_words(axes: Axes) -> str:
    """Describe how a captured body's axes are turned, such as `turned by 90 deg about the vertical axis`."""
    deg, (x, y, z) = axes.turned_deg, axes.turned_rad / max(float(np.linalg.norm(axes.turned_rad)), 1e-9)
    if abs(z) > _ALONG:
        side = "right" if z > 0 else "left"
        where = "back" if deg > 135.0 else side if deg > 45.0 else f"front {side}"
        return f"turned by {deg:.0f} deg about the vertical axis: its x axis points to the vehicle's {where}"
    if abs(x) > _ALONG:
        return f"rolled by {deg:.0f} deg: its {'right' if x > 0 else 'left'} side is too low"
    if abs(y) > _ALONG:
        return f"pitched by {deg:.0f} deg: its nose is too {'high' if y > 0 else 'low'}"
    return f"turned by {deg:.0f} deg about the axis ({x:.1f}, {y:.1f}, {z:.1f}) forward, right, down"


def _cross_correlation(captured: Array, measured: Array) -> Array:
    """Return the normalised cross-correlation matrix of two series of vectors [-] (3, 3).

    Its trace is 1 for equal series.

    captured, measured: vectors at the same times (N, 3)
    """
    scale = math.sqrt(float((captured**2).sum() * (measured**2).sum()))
    return np.asarray(measured.T @ captured / scale) if scale > 1e-9 else np.zeros((3, 3))


def _rotation(h: Array) -> tuple[Array, float] | None:
    u, s, vt = np.linalg.svd(h)
    if s[1] < _RANK * s[0] or s[0] < 1e-9:
        return None
    flip = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    return u @ np.diag(flip) @ vt, float((s * flip).sum())
