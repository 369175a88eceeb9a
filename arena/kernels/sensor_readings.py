"""Sums of the true values, the noise and the bias of simulated sensors. Every function changes its first argument.

Before `add_*` the array contains noise and bias, afterwards the readings.

`arena.sim.sensors` contains the sensors. A row is one vehicle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats


def add_inertial(noise: Floats, accel_b: Floats, omega_b: Floats) -> None:
    """Add specific force [m/s2] to the columns 0 to 2, and angular velocity [rad/s] to the columns 3 to 5, both [FRD] (V, 3)."""
    for i in range(len(noise)):
        for k in range(3):
            noise[i, k] += accel_b[i, k]
            noise[i, 3 + k] += omega_b[i, k]


def add_field(noise: Floats, field_n: Floats, r_nb: Floats) -> None:
    """Add a magnetic field, rotated to the body axes, to the columns 0 to 2.

    field_n: magnetic field [gauss] [NED] (3,)
    r_nb: rotation from body to NED [-] (V, 3, 3)
    """
    for i in range(len(noise)):
        for k in range(3):
            noise[i, k] += (
                field_n[0] * r_nb[i, 0, k] + field_n[1] * r_nb[i, 1, k] + field_n[2] * r_nb[i, 2, k]
            )


def add_altitude(noise: Floats, origin_m: float, p_n: Floats) -> None:
    """Add the altitude above mean sea level to column 0, which contains the altitude error of the barometer [m].

    origin_m: altitude of the arena's origin [m]
    p_n: position [m] [NED] (V, 3)
    """
    for i in range(len(noise)):
        noise[i, 0] += origin_m - p_n[i, 2]


def limit(readings: Floats, most: Floats, width: int) -> None:
    """Limit each reading to -most .. most. NaN stays NaN. readings, most: (V, width)"""
    for i in range(len(readings)):
        for k in range(width):
            if readings[i, k] > most[i, k]:
                readings[i, k] = most[i, k]
            elif readings[i, k] < -most[i, k]:
                readings[i, k] = -most[i, k]
