"""Comparison of captured rotation with the rotation that a gyroscope measures. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from arena.geometry import Array, quat_between, quat_from_matrix, quat_log

LARGEST_DELAY_S = 0.4
SMOOTHING_S = 0.08  # rates are averaged over this time, captured ones and measured ones alike
_GRID_S = 0.01
_RANK = 0.15  # less motion than this share about a second axis does not show by how much axes are turned


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Result of comparing captured angular rates with gyroscope rates.

    captured_rad_s, gyro_rad_s: root mean square of the rates [rad/s]
    same_axes: correlation of the rates as they are, -1 to 1 [-]
    any_axes: largest correlation after a constant rotation of the captured axes, 0 to 1 [-]
    turned_rad: vector of this rotation, captured body axes to gyroscope axes [rad] [FRD] (3,); None if the vehicle
        turned about one axis only, which does not determine the rotation
    delay_s: time by which the captured motion is later than the gyroscope's [s]
    """

    captured_rad_s: float
    gyro_rad_s: float
    same_axes: float
    any_axes: float
    turned_rad: Array | None
    delay_s: float

    @property
    def turned_deg(self) -> float | None:
        """Angle between the captured body axes and the gyroscope's axes [deg]; None if not determined."""
        return None if self.turned_rad is None else math.degrees(float(np.linalg.norm(self.turned_rad)))


def captured_rates(times: ArrayLike, q_nb: ArrayLike, span_s: float = SMOOTHING_S) -> tuple[Array, Array]:
    """Compute angular rates from captured attitudes. Return times [s] (M,), rates [rad/s] [FRD] (M, 3).

    Each rate is the mean from span_s/2 before its time to span_s/2 after it.
    times: increasing [s] (N,). q_nb: captured attitudes [-] wxyz (N, 4)
    """
    t, q = np.asarray(times, float), np.asarray(q_nb, float)
    first = np.searchsorted(t, t - span_s / 2.0 - 1e-9)
    last = np.searchsorted(t, t + span_s / 2.0 + 1e-9) - 1
    inner = (t - span_s / 2.0 >= t[0]) & (t + span_s / 2.0 <= t[-1]) & (t[last] - t[first] > span_s / 2.0)
    first, last = first[inner], last[inner]
    rates = quat_log(quat_between(q[first], q[last])) / (t[last] - t[first])[:, None]
    return (t[first] + t[last]) / 2.0, rates


def mean_rates(times: ArrayLike, gyro_b: ArrayLike, span_s: float = SMOOTHING_S) -> tuple[Array, Array]:
    """Compute mean rates of the gyroscope. Return times [s] (M,), rates [rad/s] [FRD] (M, 3).

    Each rate is the mean from span_s/2 before its time to span_s/2 after it.
    times: increasing [s] (N,). gyro_b: gyroscope samples [rad/s] [FRD] (N, 3)
    """
    t, w = np.asarray(times, float), np.asarray(gyro_b, float)
    turned = np.vstack([np.zeros(3), np.cumsum((w[1:] + w[:-1]) / 2.0 * np.diff(t)[:, None], axis=0)])
    inner = t[(t - span_s / 2.0 >= t[0]) & (t + span_s / 2.0 <= t[-1])]
    return inner, (_at(inner + span_s / 2.0, t, turned) - _at(inner - span_s / 2.0, t, turned)) / span_s


def compare(
    captured: tuple[Array, Array], gyro: tuple[Array, Array], largest_delay_s: float = LARGEST_DELAY_S
) -> Comparison | None:
    """Find the delay at which captured angular rates agree best with the gyroscope, and compare them.

    Returns None if there are not enough samples.
    captured, gyro: times [s] (N,) and rates [rad/s] [FRD] (N, 3), from `captured_rates` and `mean_rates`. The delay is
    searched within +-largest_delay_s.
    """
    (ct, cw), (gt, gw) = captured, gyro
    if len(ct) < 5 or len(gt) < 5:
        return None
    inner = (gt - largest_delay_s >= ct[0]) & (gt + largest_delay_s <= ct[-1])
    gt, gw = gt[inner], gw[inner]
    if len(gt) < 10:
        return None
    grid = np.arange(-largest_delay_s, largest_delay_s + _GRID_S / 2.0, _GRID_S)
    scores = np.array([_fit(_at(gt + delay, ct, cw), gw)[0] for delay in grid])
    best = int(np.argmax(scores))
    delay = float(grid[best]) + _GRID_S * _peak(scores, best)
    moved = _at(gt + delay, ct, cw)
    any_axes, same_axes, turned = _fit(moved, gw)
    return Comparison(
        captured_rad_s=_rms(moved),
        gyro_rad_s=_rms(gw),
        same_axes=same_axes,
        any_axes=any_axes,
        turned_rad=turned,
        delay_s=delay,
    )


def _fit(captured: Array, gyro: Array) -> tuple[float, float, Array | None]:
    """Find the rotation of the captured axes with which captured and gyroscope rates agree best.

    Returns the correlation after this rotation, the correlation without this rotation, and its rotation vector [rad].
    The rotation is that of Kabsch (1976), without a reflection.
    """
    h = gyro.T @ captured
    scale = math.sqrt(float((captured**2).sum() * (gyro**2).sum()))
    if scale < 1e-9:
        return 0.0, 0.0, None
    u, s, vt = np.linalg.svd(h)
    flip = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    turned = _vector(u @ np.diag(flip) @ vt) if s[1] > _RANK * s[0] else None
    return float((s * flip).sum()) / scale, float(np.trace(h)) / scale, turned


def _vector(m: Array) -> Array:
    """Return the rotation vector of a rotation matrix [rad] (3,)."""
    return quat_log(quat_from_matrix(m))


def _peak(scores: Array, best: int) -> float:
    """Return how far the true maximum of the scores is from the best grid point [grid steps].

    The maximum of a parabola through the best score and its two neighbours is the true maximum.
    """
    if not 0 < best < len(scores) - 1:
        return 0.0
    before, top, after = scores[best - 1 : best + 2]
    bend = before - 2.0 * top + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def _at(t: Array, times: Array, values: Array) -> Array:
    return np.stack([np.interp(t, times, values[:, k]) for k in range(values.shape[1])], axis=-1)


def _rms(rates: Array) -> float:
    return math.sqrt(float((rates**2).sum(axis=1).mean()))
