"""Rotors of a whole fleet: lag of the command, thrust, reaction torque, drag of the air. Pure, batched.

Thrust follows the profile's static curve at the lagged command and fades with airspeed as that curve says
(rotors in fast air bite less). Drag is linear in the airspeed, which is what spinning rotors feel (Mahony,
Kumar and Corke, 2012, section III-B); fuselage drag, ground effect and the rotors' own angular momentum are
left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.sim.fleet import GRID, Fleet

Array = NDArray[np.float64]

_LEAST_SHARE = 0.1  # as in the thrust curve: no speed takes more than this away


class Rotors:
    """spin: what the rotors do, as the command that would hold it, 0..1 [-] (V, R)."""

    def __init__(self, fleet: Fleet, *, step_s: float) -> None:
        self._fleet = fleet
        self.spin: Array = np.zeros((fleet.size, fleet.rotors))
        self._rise = 1.0 - np.exp(-step_s / np.maximum(fleet.tau_up, 1e-6))
        self._fall = 1.0 - np.exp(-step_s / np.maximum(fleet.tau_down, 1e-6))
        # Tables end to end, with their slope beside them: a look-up is one take, not one per vehicle.
        rises = np.diff(fleet.thrust, axis=1, append=fleet.thrust[:, -1:])
        self._table, self._slope = fleet.thrust.ravel(), rises.ravel()
        self._row = np.arange(fleet.size)[:, None] * (GRID + 1)
        self._fades = bool(fleet.speed_loss.any())

    def step(self, motors: Array, air_b: Array) -> tuple[Array, Array]:
        """One physics step. motors: commands 0..1 (V, R). air_b: velocity through the air [m/s] [FRD] (V, 3).

        Returns force [N] and torque about the centre of mass [N m], both [FRD] (V, 3).
        """
        gap = motors - self.spin
        self.spin = self.spin + gap * np.where(gap > 0.0, self._rise, self._fall)
        wrench = (self._fleet.wrench @ self._thrust(air_b)[:, :, None])[:, :, 0]
        force = air_b * -self._fleet.drag
        force[:, 2] += wrench[:, 3]
        return force, wrench[:, :3]

    def _thrust(self, air_b: Array) -> Array:
        """[N] (V, R)."""
        place = self.spin * GRID
        cell = place.astype(np.intp)
        at = cell + self._row
        thrust: Array = self._table[at] + (place - cell) * self._slope[at]
        if self._fades:
            lost = np.sqrt((air_b * air_b).sum(axis=1)) * self._fleet.speed_loss
            thrust *= np.maximum(1.0 - lost, _LEAST_SHARE)[:, None]
        return thrust
