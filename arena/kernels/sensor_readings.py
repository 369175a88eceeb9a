"""Simulated sensor readings: sums of true values, noise and bias.

Every `add_*` changes its first argument, which contains noise and bias before, and the readings afterwards.

`arena.sim.sensors` contains the sensors. A row is one vehicle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.arrays import view

if TYPE_CHECKING:
    from arena.kernels.arrays import Array


class TrueMotion:
    """True motion of V vehicles, which sensors measure.

    accel_b, omega_b: specific force [m/s2] and angular velocity [rad/s] [FRD] (V, 3)
    r_nb: rotation from body to NED [-] (V, 3, 3)
    p_n: position of the body origin [m] [NED] (V, 3)
    """

    def __init__(self, accel_b: Array, omega_b: Array, r_nb: Array, p_n: Array) -> None:
        self.accel_b, self.omega_b, self.r_nb, self.p_n = view(accel_b), view(omega_b), view(r_nb), view(p_n)

    def add_inertial(self, noise: Array) -> None:
        """Add the true specific force [m/s2] and angular velocity [rad/s] to the IMU's noise, in place [FRD] (V, 6).

        Specific force is in the columns 0 to 2, angular velocity in the columns 3 to 5.
        """
        for i in range(len(noise)):
            for k in range(3):
                noise[i, k] += self.accel_b[i, k]
                noise[i, 3 + k] += self.omega_b[i, k]

    def add_field(self, noise: Array, north: float, east: float, down: float) -> None:
        """Add the true magnetic field, rotated to body axes, to the magnetometer's noise (columns 0 to 2), in place.

        north, east, down: magnetic field [gauss]
        """
        for i in range(len(noise)):
            for k in range(3):
                noise[i, k] += (
                    north * self.r_nb[i, 0, k] + east * self.r_nb[i, 1, k] + down * self.r_nb[i, 2, k]
                )

    def add_altitude(self, noise: Array, origin_m: float) -> None:
        """Add the true altitude above sea level [m] to the barometer's altitude error (column 0), in place.

        origin_m: altitude of the arena's origin [m]
        """
        for i in range(len(noise)):
            noise[i, 0] += origin_m - self.p_n[i, 2]


class ReadingLimits:
    """Ranges of the sensors of V vehicles. most: largest absolute value of each reading (V, width)."""

    def __init__(self, most: Array) -> None:
        self.most = view(most)

    def limit(self, readings: Array, width: int) -> None:
        """Limit each sensor reading to the range of the sensor, -most .. most. NaN stays NaN.

        readings: (V, width)
        """
        for i in range(len(readings)):
            for k in range(width):
                if readings[i, k] > self.most[i, k]:
                    readings[i, k] = self.most[i, k]
                elif readings[i, k] < -self.most[i, k]:
                    readings[i, k] = -self.most[i, k]
