"""Rotors of a whole fleet: lag of the command, thrust, reaction torque, drag of the air, ground effect. Pure, batched.

Lag: first order, quicker up than down, as in PX4's Gazebo models (RotorS: Furrer, Burri, Achtelik and Siegwart, 2016).
Thrust: the profile's static curve at the lagged command, which fades with airspeed as that curve says.
Supply: a speed controller without feedback turns its motor at command times voltage, so the lagged command follows
    motors * volts / thrust_at_v of the profile's battery; without that figure the controllers hold the speed.
Rotor drag: linear in the airspeed (blade flapping and induced drag: Mahony, Kumar and Corke, "Multirotor aerial vehicles",
    2012, section III-B), and in proportion to the rotors' speed, which goes with the root of the thrust; the profile's figure
    is the one at hover. Faessler, Franchi and Scaramuzza (2018) found such a constant to be enough up to 5 m/s.
Body drag: quadratic in the airspeed, along each body axis.
Ground effect: thrust grows near the floor; see `ground.py`.
Left out: the rotors' own angular momentum, what one vehicle's wake does to another, walls and ceilings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.sim.ground import CELLS
from arena.sim.vehicle_arrays import GRID, Fleet

Array = NDArray[np.float64]

LEAST_SHARE = 0.1  # as in the thrust curve: no speed takes more than this away


class Rotors:
    """spin: what the rotors do, as the command that would hold it at nominal voltage, 0..1 [-] (V, R).

    wrench: the fleet's, but for rotors that have been weakened (V, 4, R).
    supply: voltage now per nominal, where the profile lets it matter, else 1 [-] (V, 1); the world keeps it.
    rise, fall: share of the gap to the command that a step closes (V, 1). slope: thrust per cell of the curve's grid
    [N] (V, GRID + 1).
    """

    def __init__(self, fleet: Fleet, *, step_s: float) -> None:
        self._fleet = fleet
        self.spin: Array = np.zeros((fleet.size, fleet.rotors))
        self.wrench: Array = fleet.wrench.copy()
        self.supply: Array = np.ones((fleet.size, 1))
        self.sags = bool(fleet.per_volt.any())
        self.rise = 1.0 - np.exp(-step_s / np.maximum(fleet.tau_up, 1e-6))
        self.fall = 1.0 - np.exp(-step_s / np.maximum(fleet.tau_down, 1e-6))
        # Tables end to end, with their slope beside them: a look-up is one take, not one per vehicle.
        self.slope: Array = np.diff(fleet.thrust, axis=1, append=fleet.thrust[:, -1:])
        self._table, self._slope = fleet.thrust.ravel(), self.slope.ravel()
        self._row = np.arange(fleet.size)[:, None] * (GRID + 1)
        self._fades = bool(fleet.speed_loss.any())
        self._drag, self._body = -fleet.drag, -fleet.body_drag
        self._blunt = bool(fleet.body_drag.any())
        self._reach = float(fleet.ground_reach.max())

    def weaken(self, vehicle: int, rotor: int, share: float) -> None:
        """A broken propeller: the rotor (0..) turns as it is told and gives that share of its thrust and torque."""
        self.wrench[vehicle, :, rotor] = share * self._fleet.wrench[vehicle, :, rotor]

    def step(self, motors: Array, air_b: Array, height: Array) -> tuple[Array, Array]:
        """One physics step. motors: commands 0..1 (V, R). air_b: velocity through the air [m/s] [FRD] (V, 3).
        height of the body origins above the floor [m] (V,).

        Returns force [N] and torque about the centre of mass [N m], both [FRD] (V, 3).
        """
        gap = (np.minimum(motors * self.supply, 1.0) if self.sags else motors) - self.spin
        self.spin = self.spin + gap * np.where(gap > 0.0, self.rise, self.fall)
        wrench = (self.wrench @ self._thrust(air_b, height)[:, :, None])[:, :, 0]
        lift = wrench[:, 3]
        force = air_b * self._drag
        force *= np.sqrt(lift * self._fleet.per_weight)[:, None]  # both are negative: up
        if self._blunt:
            force += air_b * np.abs(air_b) * self._body
        force[:, 2] += lift
        return force, wrench[:, :3]

    def _thrust(self, air_b: Array, height: Array) -> Array:
        """[N] (V, R)."""
        place = self.spin * GRID
        cell = place.astype(np.intp)
        at = cell + self._row
        thrust: Array = self._table.take(at) + (place - cell) * self._slope.take(at)
        if self._fades:
            lost = np.sqrt(np.add.reduce(air_b * air_b, 1)) * self._fleet.speed_loss
            thrust *= np.maximum(1.0 - lost, LEAST_SHARE)[:, None]
        if height.min() < self._reach:
            thrust *= self._ground(height)[:, None]
        return thrust

    def _ground(self, height: Array) -> Array:
        """Thrust here per thrust far from the floor [-] (V,)."""
        fleet = self._fleet
        place = np.minimum(np.maximum(height * fleet.ground_scale, 0.0), CELLS - 1e-9)
        cell = place.astype(np.intp)
        at = cell + np.arange(fleet.size) * (CELLS + 1)
        low, high = fleet.ground.take(at), fleet.ground.take(at + 1)
        return np.asarray(low + (place - cell) * (high - low))
