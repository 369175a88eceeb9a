"""Minimum-snap trajectory through waypoints.

Between two waypoints each axis is a polynomial of degree seven. Among all functions that pass the waypoints at the given times and
rest at both ends, the integral of the squared snap (fourth derivative) is smallest for the spline whose first six derivatives
are continuous at the inner waypoints. D. Mellinger and V. Kumar, "Minimum snap trajectory generation and control for
quadrotors", ICRA 2011; the spline is the solution of their problem without inequality constraints.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import ArrayLike

from arena.errors import InputError
from arena.geometry import Array
from arena.portable_math import product, solve
from arena.trajectories.trajectory import Reference

_COEFFICIENTS = 8


class MinimumSnap:
    """Minimum-snap trajectory through waypoints, from rest to rest.

    waypoints: positions [m] [NED] (n, 3), n >= 2.  times_s: duration of each segment [s] (n - 1,), see `segment_times`.
    yaw: [rad] at each waypoint (n,), or one number. Yaw follows the same kind of polynomial.
    Raises InputError if the shapes do not fit or a time is not above 0.
    """

    def __init__(self, waypoints: ArrayLike, times_s: ArrayLike, yaw: ArrayLike = 0.0) -> None:
        points, times = np.asarray(waypoints, float), np.asarray(times_s, float)
        n = len(points)
        if points.shape != (n, 3) or n < 2 or times.shape != (n - 1,) or not np.isfinite(points).all():
            raise InputError(
                f"minimum snap: got waypoints of shape {points.shape} and times of shape {times.shape}, expected (n, 3) and (n - 1,)"
            )
        if not (np.isfinite(times).all() and (times > 0.0).all()):
            raise InputError(f"minimum snap: got the times {times.tolist()} s, expected numbers above 0")
        angles = np.unwrap(np.broadcast_to(np.asarray(yaw, float), (n,)))
        self._times, self._ends = times, np.cumsum(times)
        self._coefficients = _solve(np.column_stack([points, angles]), times)

    @property
    def duration_s(self) -> float:
        return float(self._ends[-1])

    def at(self, t: float) -> Reference:
        t = min(max(t, 0.0), self.duration_s)
        k = min(int(np.searchsorted(self._ends, t, side="right")), len(self._times) - 1)
        h = self._times[k]
        u = (t - (self._ends[k] - h)) / h
        pos, vel, acc = (product(_powers(u, order), self._coefficients[k]) / h**order for order in range(3))
        return Reference(pos=pos[:3], vel=vel[:3], acc=acc[:3], yaw=float(pos[3]), yaw_rate=float(vel[3]))


def segment_times(waypoints: ArrayLike, speed_m_s: float, least_s: float = 0.5) -> Array:
    """Return the duration of each segment between waypoints for a mean speed [s] (n - 1,).

    waypoints: [m] [NED] (n, 3).  speed_m_s: mean speed [m/s].  least_s: shortest duration of a segment [s].
    The first and the last segment get twice the time, because the vehicle starts and stops there.
    """
    points = np.asarray(waypoints, float)
    ways = np.diff(points, axis=0)
    times = np.sqrt((ways * ways).sum(1)) / speed_m_s
    if times.size:
        times[[0, -1]] *= 2.0
    found: Array = np.maximum(times, least_s)
    return found


def _powers(u: float, order: int) -> Array:
    """Return the derivatives of the eight powers 1, u, u^2, ..., u^7 at u (8,).

    order: order of the derivative
    """
    row = np.zeros(_COEFFICIENTS)
    for power in range(order, _COEFFICIENTS):
        row[power] = factorial(power) / factorial(power - order) * u ** (power - order)
    return row


def _solve(points: Array, times: Array) -> Array:
    """Return the polynomial coefficients of each segment and axis (n - 1, 8, axes).

    The argument of a polynomial runs from 0 to 1.
    """
    count = len(times)
    size = _COEFFICIENTS * count
    matrix, right = np.zeros((size, size)), np.zeros((size, points.shape[1]))
    row = 0

    def add(parts: list[tuple[int, Array]], value: Array | float = 0.0) -> None:
        nonlocal row
        for segment, factors in parts:
            matrix[row, _COEFFICIENTS * segment : _COEFFICIENTS * (segment + 1)] = factors
        right[row] = value
        row += 1

    for order in (1, 2, 3):  # at rest at both ends
        add([(0, _powers(0.0, order))])
        add([(count - 1, _powers(1.0, order))])
    for k in range(count):
        add([(k, _powers(0.0, 0))], points[k])
        add([(k, _powers(1.0, 0))], points[k + 1])
    for k in range(count - 1):
        ratio = times[k] / times[k + 1]
        for order in range(1, 7):
            add([(k, _powers(1.0, order)), (k + 1, -_powers(0.0, order) * ratio**order)])
    return solve(matrix, right).reshape(count, _COEFFICIENTS, -1)
