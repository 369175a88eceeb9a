"""Rotors of multirotors: motor lag, thrust, reaction torque, drag and ground effect.

`arena.vehicle_models` names the sources.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import limits
from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats

    Wrench = tuple[float, float, float, float, float, float]

MIN_THRUST_SHARE = 0.1
"""Share of the thrust that remains at any airspeed [-], as in the thrust curve."""


class RotorDynamics:
    """Rotor dynamics of V vehicles with at most R rotors each.

    motors: input: motor commands 0..1 [-] (V, R)
    air_b: input of `step`: velocity relative to the air [m/s] [FRD] (V, 3)
    height: input of `step`: height of the body origin above the floor [m] (V,)
    supply: input: battery voltage divided by nominal voltage [-] (V,)
    rise, fall: share of the gap to the command that one step closes [-] (V,)
    thrust_table, speed_table: thrust [N] and speed [rad/s] of one rotor at equidistant commands 0..1 (V, N)
    ground_table: thrust at a height divided by the thrust far from the floor [-] (V, M)
    ground_scale, ground_reach: cells of the table per height [1/m], and height above which it is 1 [m] (V,)
    speed_loss: share of the thrust that is lost per airspeed [s/m] (V,)
    drag, body_drag: drag of rotors in hover [kg/s] and of the body [kg/m] (V, 3)
    per_weight: 1 / weight [1/N] (V,)
    spin_up: torque about the body's z axis per change of a rotor's speed in one step [N m s] (V, R)
    wrench: matrix from thrusts to torque x, y, z [N m] and force z [N] [FRD] (V, 4, R)
    spin: rotor state: the command that would maintain it at nominal voltage, 0..1 [-] (V, R)
    force, torque: output of `step`: on the body [N] and about its centre of mass [N m] [FRD] (V, 3)
    """

    def __init__(self, vehicles: int, rotors: int, cells: int, ground_cells: int) -> None:
        v, self.rotors, self.cells, self.ground_cells = vehicles, rotors, cells, ground_cells
        self.motors, self.spin, self.spin_up = floats(v, rotors), floats(v, rotors), floats(v, rotors)
        self.air_b, self.height, self.supply = floats(v, 3), floats(v), floats(v, fill=1.0)
        self.rise, self.fall, self.wrench = floats(v), floats(v), floats(v, 4, rotors)
        self.thrust_table, self.speed_table = floats(v, cells + 1), floats(v, cells + 1)
        self.ground_table = floats(v, ground_cells + 1)
        self.ground_scale, self.ground_reach = floats(v), floats(v)
        self.speed_loss, self.per_weight = floats(v), floats(v)
        self.drag, self.body_drag = floats(v, 3), floats(v, 3)
        self.force, self.torque = floats(v, 3), floats(v, 3)

    def step(self) -> None:
        """Make one physics step of the rotors of all vehicles."""
        for i in range(len(self.height)):
            air = self.air_b
            fx, fy, fz, tx, ty, tz = self._wrench_of(i, air[i, 0], air[i, 1], air[i, 2], self.height[i])
            self.force[i, 0], self.force[i, 1], self.force[i, 2] = fx, fy, fz
            self.torque[i, 0], self.torque[i, 1], self.torque[i, 2] = tx, ty, tz

    def _wrench_of(self, i: int, ax: float, ay: float, az: float, height: float) -> Wrench:
        """Make one physics step of the rotors of vehicle i. Return force [N] and torque [N m] [FRD].

        The result is force x, y, z and torque x, y, z.

        ax, ay, az: velocity relative to the air [m/s] [FRD]
        height: height of the body origin above the floor [m]
        """
        share = 1.0 - math.sqrt(ax * ax + ay * ay + az * az) * self.speed_loss[i]
        share = max(share, MIN_THRUST_SHARE) * self._ground_share(i, height)
        tx = ty = tz = fz = 0.0
        for k in range(self.rotors):
            before = self.spin[i, k]
            gap = min(self.motors[i, k] * self.supply[i], 1.0) - before
            after = before + gap * (self.rise[i] if gap > 0.0 else self.fall[i])
            self.spin[i, k] = after
            thrust = self._at(self.thrust_table, i, after * self.cells, self.cells) * share
            tx += self.wrench[i, 0, k] * thrust
            ty += self.wrench[i, 1, k] * thrust
            tz += self.wrench[i, 2, k] * thrust
            fz += self.wrench[i, 3, k] * thrust
            if self.spin_up[i, k] != 0.0:
                gained = self._at(self.speed_table, i, after * self.cells, self.cells)
                gained -= self._at(self.speed_table, i, before * self.cells, self.cells)
                tz += self.spin_up[i, k] * gained
        speed = math.sqrt(max(-fz * self.per_weight[i], 0.0))  # of the rotors, divided by that in hover
        dx = self.drag[i, 0] * speed + self.body_drag[i, 0] * abs(ax)
        dy = self.drag[i, 1] * speed + self.body_drag[i, 1] * abs(ay)
        dz = self.drag[i, 2] * speed + self.body_drag[i, 2] * abs(az)
        return -dx * ax, -dy * ay, fz - dz * az, tx, ty, tz

    def _ground_share(self, i: int, height: float) -> float:
        """Return the ground effect: the thrust at a height divided by the thrust far from the floor [-]."""
        if height >= self.ground_reach[i]:
            return 1.0
        place = limits.within(height * self.ground_scale[i], 0.0, self.ground_cells)
        return self._at(self.ground_table, i, place, self.ground_cells)

    def _at(self, table: Floats, i: int, place: float, cells: int) -> float:
        """Return the value at position `place` in row i of a table, by linear interpolation.

        place: index of the value in the row, 0..cells, with a fraction
        """
        cell = int(place)
        low = table[i, cell]
        return low + (place - cell) * (table[i, min(cell + 1, cells)] - low)
