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
        self._n = self._e = self._d = self._axis_n = self._axis_e = self._axis_d = 0.0
        self._above = self._along = 0.0

    def reaches(self, p_n: Floats, r_nb: Floats) -> bool:
        """Return whether the jet of any vehicle reaches another vehicle.

        p_n: position of the body origins [m] [NED] (V, 3)
        r_nb: rotation matrix of the attitude (V, 3, 3)
        """
        count = len(self.factor)
        for upper in range(count):
            if self._set_jet(p_n, r_nb, upper):
                for lower in range(count):
                    if self._shape(p_n, lower) > 0.0:
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
            if not self._set_jet(p_n, r_nb, upper):
                continue
            root = self.factor[upper] * math.sqrt(max(thrust[upper], 0.0))
            for lower in range(count):
                shape = self._shape(p_n, lower)
                if shape > 0.0:
                    s = self._along
                    speed = _SPEED * root / (s / self.length[upper] + _ORIGIN)
                    speed *= shape * min(s / self.radius[upper], 1.0)
                    wind[lower, 0] += speed * self._axis_n
                    wind[lower, 1] += speed * self._axis_e
                    wind[lower, 2] += speed * self._axis_d

    def _set_jet(self, p_n: Floats, r_nb: Floats, upper: int) -> bool:
        """Set the origin and the axis of the jet of a vehicle, which `_shape` uses. Return False if the vehicle makes no jet."""
        self._n, self._e, self._d = p_n[upper, 0], p_n[upper, 1], p_n[upper, 2]
        self._axis_n, self._axis_e, self._axis_d = r_nb[upper, 0, 2], r_nb[upper, 1, 2], r_nb[upper, 2, 2]
        self._above = _ORIGIN * self.length[upper]
        return self.factor[upper] != 0.0

    def _shape(self, p_n: Floats, lower: int) -> float:
        """Return the speed of the jet at the lower vehicle, divided by the speed on the axis [-]; 0 outside the jet.

        Store the distance of the lower vehicle from the upper one along the axis of the jet [m].
        """
        north, east, down = p_n[lower, 0] - self._n, p_n[lower, 1] - self._e, p_n[lower, 2] - self._d
        along = self._axis_n * north + self._axis_e * east + self._axis_d * down
        if along <= 0.0:
            return 0.0
        self._along = along
        aside2 = max(north * north + east * east + down * down - along * along, 0.0) + self.rotors_out2[lower]
        half = _SPREAD * (along + self._above)
        if aside2 >= (_END * half) * (_END * half):
            return 0.0
        bell = 1.0 + _SHAPE * aside2 / (half * half)
        return 1.0 / (bell * bell) - _TAIL
