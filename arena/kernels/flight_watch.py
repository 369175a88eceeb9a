"""Extreme values of each simulated flight, and detection of touchdown, lift-off and too much tilt."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from arena.kernels.arrays import flags, floats, view

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from arena.kernels.arrays import Array


class FlightWatch:
    """Records extreme values of V flights, and detects touchdown, lift-off and too much tilt.

    step_s: time between two steps [s]
    p_n, v_n: input: position [m] and velocity [m/s] [NED] (V, 3)
    r_nb: input: rotation matrix of the attitude (V, 3, 3)
    floor: input: True for each vehicle that touches the floor (V,)
    was_on_floor: the same one step earlier (V,)
    min_cos_tilt: cosine of the largest tilt that is no crash [-] (V,)
    least_cos_tilt, least_down: smallest cosine of the tilt [-] and smallest position D [m] so far (V,)
    airborne_s: time off the floor [s] (V,)
    speed: speed after this step [m/s] (V,)
    recent: speeds after the three steps before, newest first [m/s] (V, 3)
    """

    def __init__(self, p_n: Array, v_n: Array, r_nb: Array, floor: NDArray[np.bool_], step_s: float) -> None:
        v, self.step_s = len(p_n), step_s
        self.p_n, self.v_n, self.r_nb, self.floor = view(p_n), view(v_n), view(r_nb), flags(floor)
        self.was_on_floor = flags(np.ones(v, bool))
        self.min_cos_tilt, self.least_cos_tilt = floats(v), floats(v, fill=1.0)
        self.least_down, self.airborne_s = floats(v, fill=math.inf), floats(v)
        self.speed, self.recent = floats(v), view(np.zeros((v, 3)))

    def step(self) -> bool:
        """Update all measurements, such as the largest tilt. Return whether a vehicle touched down, lifted off or tilted too far.

        The caller finds these vehicles by comparing `floor` with `was_on_floor`, and the tilt with `min_cos_tilt`. After that
        the caller calls `finish`.
        """
        news = False
        for i in range(len(self.floor)):
            cos_tilt = self.r_nb[i, 2, 2]
            self.least_cos_tilt[i] = min(self.least_cos_tilt[i], cos_tilt)
            self.least_down[i] = min(self.least_down[i], self.p_n[i, 2])
            if not self.floor[i]:
                self.airborne_s[i] += self.step_s
            self.recent[i, 2], self.recent[i, 1] = self.recent[i, 1], self.recent[i, 0]
            self.recent[i, 0] = self.speed[i]
            x, y, z = self.v_n[i, 0], self.v_n[i, 1], self.v_n[i, 2]
            self.speed[i] = math.sqrt(x * x + y * y + z * z)
            if cos_tilt < self.min_cos_tilt[i] or self.floor[i] != self.was_on_floor[i]:
                news = True
        return news

    def speed_before(self, i: int) -> float:
        """Return the largest speed of vehicle i in the three steps before the present step [m/s]."""
        return max(self.recent[i, 0], self.recent[i, 1], self.recent[i, 2])

    def finish(self) -> None:
        """Store which vehicles touch the floor now, so that the next `step` can detect a change."""
        for i in range(len(self.floor)):
            self.was_on_floor[i] = self.floor[i]
