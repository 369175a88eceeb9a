"""Search for vehicles that stand still with stopped motors, so that their contacts need not be computed.

Pybullet computes the contacts of a standing vehicle in every physics step, which costs more than a flying one, and moves it by some
1e-8 m per step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.sim.pybullet_room import Motion

Array = NDArray[np.float64]

_SLOW_M_S = 1e-4
_SLOW_RAD_S = 1e-3
_STOPPED = 1e-3
"""Rotor speed below which a rotor counts as stopped, as a share of full speed [-]. Its thrust is a millionth of the greatest."""
_PERIODS = 25
"""Sensor periods after which still vehicles rest. A vehicle in the air would have fallen by then, even from its highest point."""


class Rest:
    """Search for the rest of the vehicles in pybullet.

    They rest when all of them are still, their motors are stopped, and the air moves as before, for 25 sensor periods.
    A resting vehicle has no velocity, and keeps its position and attitude.

    state: motion of all vehicles; `check` sets the velocities of resting vehicles to zero
    """

    def __init__(self, state: Motion) -> None:
        self._state, self._still_periods, self._wind = state, 0, b""

    def reset(self) -> None:
        """End the rest, because vehicles were moved, or have been added to those in pybullet or removed."""
        self._still_periods = 0

    def check(self, rows: NDArray[np.int_], motors: Array, spin: Array, wind_n: Array) -> bool:
        """Return whether the vehicles in pybullet rest in the sensor period that begins.

        rows: rows of the vehicles in pybullet (n,)
        motors, spin: motor commands and rotor speeds, as shares of the greatest [-] (V, R)
        wind_n: motion of the air at each vehicle [m/s] [NED] (V, 3)
        """
        wind, before = wind_n[rows].tobytes(), self._wind
        self._wind = wind
        if wind != before or motors[rows].any() or spin[rows].max() > _STOPPED or not self._is_slow(rows):
            self._still_periods = 0
            return False
        self._still_periods += 1
        if self._still_periods == _PERIODS:
            self._state.speed[rows] = self._state.rate[rows] = 0.0
        return self._still_periods >= _PERIODS

    def _is_slow(self, rows: NDArray[np.int_]) -> bool:
        speed, rate = np.abs(self._state.speed[rows]), np.abs(self._state.rate[rows])
        return bool(speed.max() < _SLOW_M_S and rate.max() < _SLOW_RAD_S)
