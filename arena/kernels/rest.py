"""Search for vehicles that stand still with stopped motors, so that their contacts need not be computed.

Pybullet computes the contacts of a standing vehicle in every physics step, which costs more than a flying one, and moves it by some
1e-8 m per step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.free_flight import FreeFlight
    from arena.kernels.rotor_dynamics import RotorDynamics

_SLOW_M_S = 1e-4
_SLOW_RAD_S = 1e-3
_STOPPED = 1e-3  # share of full rotor speed [-]: a millionth of the greatest thrust
_PERIODS = 25  # a vehicle in the air would have fallen by then, even from its highest point


class Rest:
    """Search for the rest of the vehicles that pybullet moves.

    They rest when all of them are still, their motors are stopped, and the air moves as before, for 25 sensor periods.
    A resting vehicle has no velocity, and keeps its position and attitude.

    rotors, bodies: kernels of rotors and bodies; vehicles that are not in free flight are in pybullet
    periods: number of sensor periods since the last change
    """

    def __init__(self, rotors: RotorDynamics, bodies: FreeFlight) -> None:
        self.rotors, self.bodies = rotors, bodies
        self.periods = 0
        self._wind_n = floats(len(bodies.free), 3)

    def reset(self) -> None:
        """End the rest, because vehicles were moved, or have come into pybullet or left it."""
        self.periods = 0

    def check(self) -> bool:
        """Return whether all vehicles in pybullet rest in the sensor period that begins. Call it once per period."""
        still = True
        for i in range(len(self.bodies.free)):
            if not self.bodies.free[i] and not self._is_still(i):
                still = False
        self.periods = self.periods + 1 if still else 0
        if self.periods == _PERIODS:
            for i in range(len(self.bodies.free)):
                if not self.bodies.free[i]:
                    for k in range(3):
                        self.bodies.speed_w[i, k] = self.bodies.rate_w[i, k] = 0.0
        return self.periods >= _PERIODS

    def _is_still(self, i: int) -> bool:
        """Return whether vehicle i does not move, its motors are stopped and its wind has not changed. Store its wind."""
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
