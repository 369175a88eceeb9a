"""Moves the bodies of a small fleet by one sensor period. It uses plain floats, which are faster than numpy
for few vehicles.

With one or two vehicles most of the time of a batched step is numpy's cost per call. The equations are those
of the batched step in `world`, and the results are the same except for rounding; a test compares them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.sim.bodies import Bodies, Matrix, Triple
from arena.vehicle_models import Dynamics

Array = NDArray[np.float64]

MAX_SCALAR_VEHICLES = 2
"""Largest number of vehicles for which this is faster than the batched step (benchmarks/world.py)."""


class ScalarStep:
    """Moves the bodies of at most `MAX_SCALAR_VEHICLES` vehicles. For few vehicles, its plain floats are faster than numpy.

    step_s: physics step [s]
    """

    def __init__(self, bodies: Bodies, dynamics: Dynamics, vehicles: int, *, step_s: float) -> None:
        self._bodies, self._dynamics, self._h = bodies, dynamics, step_s
        self._count = vehicles

    def advance(self, motors: Array, wind_n: Array, substeps: int) -> Array:
        """Move the bodies by one sensor period.

        motors: motor commands 0..1 [-] (V, R)
        wind_n: motion of the air at each vehicle [m/s] [NED] (V, 3)
        substeps: number of physics steps in the period

        Returns the mean specific force [m/s2] [FRD] (V, 3).
        """
        bodies, wind, dynamics, count = self._bodies, wind_n.tolist(), self._dynamics, self._count
        dynamics.set_motors(motors)
        now = [bodies.motion(i) for i in range(count)]
        accel = [[0.0, 0.0, 0.0] for _ in range(count)]
        for _ in range(substeps):
            for i in range(count):
                (v, r, height), (north, east, down) = now[i], wind[i]
                air = (v[0] - north, v[1] - east, v[2] - down)
                bodies.apply_wrench(i, *dynamics.step_one(i, _b_from_n(r, air), height))
            bodies.advance()
            for i in range(count):
                before, now[i] = now[i], bodies.motion(i)
                _add(accel[i], _specific_force(before[0], before[1], now[i][0], self._h))
        bodies.read()
        return np.array(accel) / substeps


def _b_from_n(r: Matrix, v: Triple) -> Triple:
    """Rotate a vector from NED to body axes: R^T v."""
    (a, b, c), (d, e, f), (g, h, i) = r
    x, y, z = v
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def _specific_force(v: Triple, r: Matrix, after: Triple, h: float) -> Triple:
    """Return the mean specific force (acceleration minus gravity) during one step [m/s2] [FRD], from the change of velocity.

    v, after: velocity before and after the step [m/s] [NED]
    r: rotation matrix from body to NED before the step; the result is in these body axes
    h: duration of the step [s]
    """
    return _b_from_n(r, ((after[0] - v[0]) / h, (after[1] - v[1]) / h, (after[2] - v[2]) / h - GRAVITY_M_S2))


def _add(total: list[float], x: Triple) -> None:
    total[0] += x[0]
    total[1] += x[1]
    total[2] += x[2]
