"""Simulated sensor readings: sums of true values, noise and bias.

Every function changes its first argument.

Before `add_*` the array contains noise and bias, afterwards the readings.

`arena.sim.sensors` contains the sensors. A row is one vehicle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats


def add_inertial(noise: Floats, accel_b: Floats, omega_b: Floats) -> None:
    """Add the true specific force [m/s2] and angular velocity [rad/s] to the IMU's noise, in place [FRD] (V, 6).

    Specific force is in the columns 0 to 2, angular velocity in the columns 3 to 5.
    """
    for i in range(len(noise)):
        for k in range(3):
            noise[i, k] += accel_b[i, k]
            noise[i, 3 + k] += omega_b[i, k]


def add_field(noise: Floats, field_n: Floats, r_nb: Floats) -> None:
    """Add the true magnetic field, rotated to body axes, to the magnetometer's noise (columns 0 to 2), in place.

    field_n: magnetic field [gauss] [NED] (3,)
    r_nb: rotation from body to NED [-] (V, 3, 3)
    """
    for i in range(len(noise)):
        for k in range(3):
            noise[i, k] += (
                field_n[0] * r_nb[i, 0, k] + field_n[1] * r_nb[i, 1, k] + field_n[2] * r_nb[i, 2, k]
            )


def add_altitude(noise: Floats, origin_m: float, p_n: Floats) -> None:
    """Add the true altitude above sea level [m] to the barometer's altitude error (column 0), in place.

    origin_m: altitude of the arena's origin [m]
    p_n: position [m] [NED] (V, 3)
    """
    for i in range(len(noise)):
        noise[i, 0] += origin_m - p_n[i, 2]


def limit(readings: Floats, most: Floats, width: int) -> None:
    """Limit each sensor reading to the range of the sensor, -most .. most. NaN stays NaN.

    readings, most: (V, width)
    """
    for i in range(len(readings)):
        for k in range(width):
            if readings[i, k] > most[i, k]:
                readings[i, k] = most[i, k]
            elif readings[i, k] < -most[i, k]:
                readings[i, k] = -most[i, k]
