"""A sensor period of a small fleet, one vehicle after the other in plain floats: there numpy's cost per call is most of a step.

Same equations as `rotors` and `world`, same results but for rounding; a test holds them together.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.sim.bodies import Bodies, Matrix, Triple
from arena.sim.ground import CELLS
from arena.sim.rotors import LEAST_SHARE, Rotors
from arena.sim.vehicle_arrays import GRID, Fleet

Array = NDArray[np.float64]

MOST = 2
"""Vehicles up to which this is the quicker way, by benchmarks/world.py."""


class _Quad:
    """What one vehicle needs, out of numpy's hands."""

    def __init__(self, fleet: Fleet, rotors: Rotors, i: int) -> None:
        self.rise, self.fall = float(rotors.rise[i, 0]), float(rotors.fall[i, 0])
        self.table, self.slope = fleet.thrust[i].tolist(), rotors.slope[i].tolist()
        self.fit(rotors, i)
        self.drag, self.loss = tuple(fleet.drag[i].tolist()), float(fleet.speed_loss[i])
        self.body, self.per_weight = tuple(fleet.body_drag[i].tolist()), float(fleet.per_weight[i])
        self.ground: list[float] = fleet.ground[i * (CELLS + 1) : (i + 1) * (CELLS + 1)].tolist()
        self.scale, self.reach = float(fleet.ground_scale[i]), float(fleet.ground_reach[i])

    def fit(self, rotors: Rotors, i: int) -> None:
        """What its rotors give has changed."""
        self.wrench = [tuple(column) for column in rotors.wrench[i].T.tolist()]

    def push(
        self, spin: list[float], motors: list[float], air_b: Triple, height: float
    ) -> tuple[Triple, Triple]:
        """Turns the rotors on by one physics step. -> force [N] and torque [N m] [FRD]."""
        ax, ay, az = air_b
        share = (
            max(1.0 - math.sqrt(ax * ax + ay * ay + az * az) * self.loss, LEAST_SHARE) if self.loss else 1.0
        )
        if height < self.reach:
            share *= self._near(height)
        tx = ty = tz = fz = 0.0
        for k, (command, (wx, wy, wz, wf)) in enumerate(zip(motors, self.wrench, strict=True)):
            gap = command - spin[k]
            spin[k] = at = spin[k] + gap * (self.rise if gap > 0.0 else self.fall)
            place = at * GRID
            cell = int(place)
            thrust = (self.table[cell] + (place - cell) * self.slope[cell]) * share
            tx, ty, tz, fz = tx + wx * thrust, ty + wy * thrust, tz + wz * thrust, fz + wf * thrust
        (dx, dy, dz), (bx, by, bz), turning = self.drag, self.body, math.sqrt(fz * self.per_weight)
        dx, dy, dz = dx * turning + bx * abs(ax), dy * turning + by * abs(ay), dz * turning + bz * abs(az)
        return (-dx * ax, -dy * ay, fz - dz * az), (tx, ty, tz)

    def _near(self, height: float) -> float:
        """Thrust here per thrust far from the floor [-]."""
        place = max(height * self.scale, 0.0)
        cell = int(place)
        low = self.ground[cell]
        return low + (place - cell) * (self.ground[cell + 1] - low)


class Few:
    """Moves the bodies of a fleet of at most `MOST` under its rotors."""

    def __init__(self, fleet: Fleet, bodies: Bodies, rotors: Rotors, *, step_s: float) -> None:
        self._bodies, self._rotors, self._h = bodies, rotors, step_s
        self._quads = [_Quad(fleet, rotors, i) for i in range(fleet.size)]

    def fit(self, vehicle: int) -> None:
        """A rotor of it has been weakened."""
        self._quads[vehicle].fit(self._rotors, vehicle)

    def move(self, motors: Array, wind_n: Array, substeps: int) -> Array:
        """motors: commands 0..1 (V, R); wind_n [m/s] (3,). -> mean specific force [m/s2] [FRD] (V, 3)."""
        bodies, wind = self._bodies, wind_n.tolist()
        rotors = self._rotors
        if rotors.sags:
            motors = np.minimum(motors * rotors.supply, 1.0)
        commands, spins = motors.tolist(), rotors.spin.tolist()
        count = len(self._quads)
        now = [bodies.motion(i) for i in range(count)]
        felt = [[0.0, 0.0, 0.0] for _ in range(count)]
        for _ in range(substeps):
            for i, quad in enumerate(self._quads):
                v, r, height = now[i]
                air = (v[0] - wind[0], v[1] - wind[1], v[2] - wind[2])
                bodies.push_one(i, *quad.push(spins[i], commands[i], _b_from_n(r, air), height))
            bodies.advance()
            for i in range(count):
                before, now[i] = now[i], bodies.motion(i)
                _add(felt[i], _felt(before[0], before[1], now[i][0], self._h))
        bodies.read()
        rotors.spin = np.array(spins)
        return np.array(felt) / substeps


def _b_from_n(r: Matrix, v: Triple) -> Triple:
    """Body axes from NED: R^T v."""
    (a, b, c), (d, e, f), (g, h, i) = r
    x, y, z = v
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def _felt(v: Triple, r: Matrix, after: Triple, h: float) -> Triple:
    """The acceleration that is not gravity's, in the axes of the body as it was before the step [m/s2] [FRD]."""
    return _b_from_n(r, ((after[0] - v[0]) / h, (after[1] - v[1]) / h, (after[2] - v[2]) / h - GRAVITY_M_S2))


def _add(total: list[float], x: Triple) -> None:
    total[0] += x[0]
    total[1] += x[1]
    total[2] += x[2]
