"""Wind that vehicles cause at each other by their downwash. `arena.sim.downwash` describes the model and its source."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats

_SPEED, _SPREAD, _ORIGIN = 10.11, 0.07668, 5.817
_SHAPE = math.sqrt(2.0) - 1.0
_END = 6.0  # half radii
_TAIL = 1.0 / (1.0 + _SHAPE * _END * _END) ** 2


class DownwashWind:
    """Computes the wind at V vehicles from the jets of the other vehicles.

    factor: induced speed per root of the thrust, multiplied by the strength of the jet [m/(s sqrt(N))]; 0 without a jet (V,)
    length: largest distance between two rotors [m] (V,)
    radius: radius of a rotor [m] (V,)
    rotors_out2: mean square of the distance of the rotors from the centre [m2] (V,)
    wind_n: output: the wind [m/s] [NED] (V, 3)
    """

    def __init__(self, factor: Floats, length: Floats, radius: Floats, rotors_out2: Floats) -> None:
        self.factor, self.length, self.radius, self.rotors_out2 = factor, length, radius, rotors_out2
        self.wind_n = floats(len(factor), 3)

    def reaches(self, p_n: Floats, r_nb: Floats) -> bool:
        """Return whether the jet of any vehicle reaches another vehicle.

        p_n: position of the body origins [m] [NED] (V, 3)
        r_nb: rotation matrix of the attitude (V, 3, 3)
        """
        count = len(self.factor)
        for upper in range(count):
            for lower in range(count):
                if self._shape(p_n, r_nb, upper, lower) > 0.0:
                    return True
        return False

    def compute(self, p_n: Floats, r_nb: Floats, thrust: Floats) -> None:
        """Compute the wind at all vehicles.

        p_n, r_nb: as for `reaches`
        thrust: thrust of each vehicle [N] (V,)
        """
        count, wind = len(self.factor), self.wind_n
        for lower in range(count):
            wind[lower, 0] = wind[lower, 1] = wind[lower, 2] = 0.0
        for upper in range(count):
            root = self.factor[upper] * math.sqrt(max(thrust[upper], 0.0))
            for lower in range(count):
                shape = self._shape(p_n, r_nb, upper, lower)
                if shape > 0.0:
                    s = self._along(p_n, r_nb, upper, lower)
                    speed = _SPEED * root / (s / self.length[upper] + _ORIGIN)
                    speed *= shape * min(s / self.radius[upper], 1.0)
                    for k in range(3):
                        wind[lower, k] += speed * r_nb[upper, k, 2]

    def _along(self, p_n: Floats, r_nb: Floats, upper: int, lower: int) -> float:
        """Return the distance of the lower vehicle from the upper one along the axis of its jet [m]."""
        return (
            r_nb[upper, 0, 2] * (p_n[lower, 0] - p_n[upper, 0])
            + r_nb[upper, 1, 2] * (p_n[lower, 1] - p_n[upper, 1])
            + r_nb[upper, 2, 2] * (p_n[lower, 2] - p_n[upper, 2])
        )

    def _shape(self, p_n: Floats, r_nb: Floats, upper: int, lower: int) -> float:
        """Return the speed of the upper vehicle's jet at the lower vehicle, divided by the speed on the axis [-]; 0 outside the jet."""
        if self.factor[upper] == 0.0:
            return 0.0
        along = self._along(p_n, r_nb, upper, lower)
        if along <= 0.0:
            return 0.0
        north, east = p_n[lower, 0] - p_n[upper, 0], p_n[lower, 1] - p_n[upper, 1]
        down = p_n[lower, 2] - p_n[upper, 2]
        apart2 = north * north + east * east + down * down
        aside2 = max(apart2 - along * along, 0.0) + self.rotors_out2[lower]
        half = _SPREAD * (along + _ORIGIN * self.length[upper])
        if aside2 >= (_END * half) * (_END * half):
            return 0.0
        bell = 1.0 + _SHAPE * aside2 / (half * half)
        return 1.0 / (bell * bell) - _TAIL
