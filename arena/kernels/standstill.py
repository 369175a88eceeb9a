"""Search for vehicles that stand still with stopped motors, so that their contacts need not be computed.

Pybullet computes the contacts of a standing vehicle in every physics step, which costs more than a flying one, and moves it by some
1e-8 m per step.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.free_flight import FreeFlight
    from arena.kernels.rotor_dynamics import RotorDynamics

_SLOW_M_S = 1e-4
_SLOW_RAD_S = 1e-3
_STOPPED = 1e-3  # share of full rotor speed [-]: a millionth of the greatest thrust
_STILL_S = 0.1  # a vehicle in the air falls by 5 cm in this time, even from its highest point


class Standstill:
    """Search for a standstill: no vehicle that pybullet moves needs it now.

    A standstill begins when all these vehicles have been still for 0.1 s: they do not move, their motors are stopped, and the air
    at each of them moves as before. During a standstill their velocities are zero, and they keep position and attitude.

    rotors, bodies: kernels of rotors and bodies. Pybullet moves the vehicles that are not in free flight
    period_s: sensor period [s]
    still_periods: number of sensor periods for which all of them have been still
    """

    def __init__(self, rotors: RotorDynamics, bodies: FreeFlight, period_s: float) -> None:
        self.rotors, self.bodies = rotors, bodies
        self.still_periods, self._needed_periods = 0, math.ceil(_STILL_S / period_s)
        self._wind_n = floats(len(bodies.free), 3)

    def end(self) -> None:
        """End the standstill, because vehicles were moved, or pybullet now moves other vehicles."""
        self.still_periods = 0

    def check(self) -> bool:
        """Return whether the bodies are held in the sensor period that begins, because they stand still.

        Call this once per period.
        """
        still = True
        for i in range(len(self.bodies.free)):
            if not self.bodies.free[i] and not self._is_still(i):
                still = False
        self.still_periods = self.still_periods + 1 if still else 0
        if self.still_periods == self._needed_periods:
            for i in range(len(self.bodies.free)):
                if not self.bodies.free[i]:
                    for k in range(3):
                        self.bodies.speed_w[i, k] = self.bodies.rate_w[i, k] = 0.0
        return self.still_periods >= self._needed_periods

    def _is_still(self, i: int) -> bool:
        """Return whether vehicle i is still: no velocity, stopped motors, and the same wind as at the last call."""
        bodies, rotors, still = self.bodies, self.rotors, True
        for k in range(3):
            if bodies.wind_n[i, k] != self._wind_n[i, k]:
                still = False
            self._wind_n[i, k] = bodies.wind_n[i, k]
            if abs(bodies.speed_w[i, k]) > _SLOW_M_S or abs(bodies.rate_w[i, k]) > _SLOW_RAD_S:
                still = False
        for k in range(rotors.rotors):
            if rotors.motors[i, k] > 0.0 or rotors.spin[i, k] > _STOPPED:
                still = False
        return still
