"""Straight line between two points, from rest to rest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from arena.errors import InputError
from arena.geometry import Array
from arena.portable_math import norm
from arena.trajectories.trajectory import Reference, from_rest

_PEAK = 1.875  # greatest speed of `from_rest`, in multiples of the mean speed


class StraightLine:
    """Flight along a straight line, from rest to rest.

    The heading turns by the shorter way.

    start, end: positions [m] [NED] (3,).  yaw: headings at both ends [rad].
    speed: greatest speed [m/s].  shortest_s: shortest duration [s].
    Raises InputError if `speed` or `shortest_s` is not above 0.
    """

    def __init__(
        self,
        start: ArrayLike,
        end: ArrayLike,
        *,
        speed: float,
        yaw: tuple[float, float] = (0.0, 0.0),
        shortest_s: float = 2.0,
    ) -> None:
        if not (speed > 0.0 and shortest_s > 0.0):
            raise InputError(
                f"straight line: got speed {speed:g} m/s and {shortest_s:g} s, expected numbers above 0"
            )
        self._start: Array = np.asarray(start, float).reshape(3)
        self._way: Array = np.asarray(end, float).reshape(3) - self._start
        self._yaw, self._turn = yaw[0], math.remainder(yaw[1] - yaw[0], 2.0 * math.pi)
        self._duration_s = max(shortest_s, _PEAK * norm(self._way) / speed)

    @property
    def duration_s(self) -> float:
        return self._duration_s

    def at(self, t: float) -> Reference:
        part, rate, bend = from_rest(t, self._duration_s)
        return Reference(
            pos=self._start + part * self._way,
            vel=rate * self._way,
            acc=bend * self._way,
            yaw=self._yaw + part * self._turn,
            yaw_rate=rate * self._turn,
        )
