"""Moves from rest to rest in the shortest time, with limited velocity, acceleration and jerk.

The library `ruckig` computes the moves.

L. Berscheid and T. Kroeger, "Jerk-limited real-time trajectory generation with arbitrary target states", RSS 2021.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from arena.errors import InputError
from arena.geometry import Array
from arena.trajectories.trajectory import Reference


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Largest velocity [m/s], acceleration [m/s2] and jerk [m/s3], horizontal and vertical.

    They are absolute values on each axis.
    """

    horizontal_m_s: float = 2.0
    vertical_m_s: float = 1.0
    acceleration_m_s2: float = 3.0
    jerk_m_s3: float = 8.0


class TimeOptimal:
    """Straight moves through waypoints in the shortest time, with a stop at each waypoint.

    All axes of a move are synchronised, so that the way is nearly straight.
    waypoints: positions [m] [NED] (n, 3), n >= 2.  yaw: [rad].
    Raises InputError if `ruckig` is not installed, or for limits or waypoints that it refuses.
    """

    def __init__(self, waypoints: ArrayLike, limits: Limits | None = None, yaw: float = 0.0) -> None:
        points = np.asarray(waypoints, float)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
            raise InputError(
                f"time-optimal moves: got waypoints of shape {points.shape}, expected (n, 3) with n of at least 2"
            )
        limits = Limits() if limits is None else limits
        self._yaw = yaw
        self._moves = [_move(a, b, limits) for a, b in itertools.pairwise(points)]
        self._ends: Array = np.cumsum([move.duration for move in self._moves])

    @property
    def duration_s(self) -> float:
        return float(self._ends[-1])

    def at(self, t: float) -> Reference:
        t = min(max(t, 0.0), self.duration_s)
        k = min(int(np.searchsorted(self._ends, t, side="right")), len(self._moves) - 1)
        pos, vel, acc = self._moves[k].at_time(t - (self._ends[k] - self._moves[k].duration))[:3]
        return Reference(pos=np.array(pos), vel=np.array(vel), acc=np.array(acc), yaw=self._yaw)


def _move(start: Array, goal: Array, limits: Limits) -> Any:
    """Compute one time-optimal move with the library `ruckig`. Return its trajectory object."""
    try:
        import ruckig
    except ImportError as error:
        raise InputError(
            "time-optimal moves need the package ruckig: pip install 'flying-arena[trajectories]'"
        ) from error
    request = ruckig.InputParameter(3)
    request.current_position, request.target_position = start.tolist(), goal.tolist()
    request.max_velocity = [limits.horizontal_m_s, limits.horizontal_m_s, limits.vertical_m_s]
    request.max_acceleration, request.max_jerk = [limits.acceleration_m_s2] * 3, [limits.jerk_m_s3] * 3
    request.synchronization = ruckig.Synchronization.Phase
    found = ruckig.Trajectory(3)
    try:
        result = ruckig.Ruckig(3).calculate(request, found)
    except Exception as error:
        raise InputError(f"time-optimal move from {start.tolist()} to {goal.tolist()}: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise InputError(
            f"time-optimal move from {start.tolist()} to {goal.tolist()}: ruckig found no solution ({result})"
        )
    return found
