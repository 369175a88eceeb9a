"""Rate controller: computes normalised torques from body rates.

Structure and parameters are PX4's.
"""

from __future__ import annotations

import math

from arena.kernels import limits
from arena.kernels.arrays import floats

_INTEGRAL_CUTOFF = 1.0 / math.radians(
    400.0
)  # a larger rate error is a transient and is not integrated [s/rad]


class RateLaw:
    """Rate controller of V vehicles.

    Each array has the columns roll, pitch, yaw [FRD] (V, 3).

    dt: time step [s]
    p, i_dt, d: gains [s], [-], [s2]; `i_dt` is the integral gain multiplied by the time step
    integral_limit: limit of each integral [-]
    low_pass: coefficients of the low-pass filters of rate, angular acceleration and yaw torque for one step 0..1
    omega_b, omega_sp: input: body rates and their setpoint [rad/s]
    saturated: input: sign of the torque that the control allocation could not deliver [-]
    rate, accel: filtered body rates [rad/s] and angular acceleration [rad/s2]
    integral: integral of the rate error [-]
    yaw_torque: filtered yaw torque [-] (V,)
    torque: output: normalised torque [-]
    """

    def __init__(self, vehicles: int, dt: float) -> None:
        self.dt, self.saturated = dt, floats(vehicles, 3)
        self.p, self.i_dt, self.d = floats(vehicles, 3), floats(vehicles, 3), floats(vehicles, 3)
        self.integral_limit, self.low_pass = floats(vehicles, 3), floats(vehicles, 3)
        self.omega_b, self.omega_sp = floats(vehicles, 3), floats(vehicles, 3)
        self.rate, self.accel, self.integral = floats(vehicles, 3), floats(vehicles, 3), floats(vehicles, 3)
        self.yaw_torque, self.torque = floats(vehicles), floats(vehicles, 3)

    def step(self) -> None:
        """Compute the torques of all vehicles for one time step."""
        for i in range(len(self.torque)):
            for axis in range(3):
                self.torque[i, axis] = self._torque(i, axis)
            # Accelerating rotors push back on the body, so the yaw torque is filtered, as on PX4.
            wanted = limits.within(self.torque[i, 2], -1.0, 1.0)
            self.yaw_torque[i] += self.low_pass[i, 2] * (wanted - self.yaw_torque[i])
            self.torque[i, 2] = self.yaw_torque[i]

    def _torque(self, i: int, axis: int) -> float:
        """Return the torque about one axis of vehicle i [-], and update its filters and integral.

        The low-pass filter of the yaw torque is not applied yet.
        """
        last, integral = self.rate[i, axis], self.integral[i, axis]
        rate = last + self.low_pass[i, 0] * (self.omega_b[i, axis] - last)
        self.rate[i, axis] = rate
        self.accel[i, axis] += self.low_pass[i, 1] * ((rate - last) / self.dt - self.accel[i, axis])
        error = self.omega_sp[i, axis] - rate
        grow = error if self.saturated[i, axis] * error <= 0.0 else 0.0
        # Large errors are transients: integrate them less, and none from 400 deg/s on.
        large = error * _INTEGRAL_CUTOFF
        grown = integral + max(0.0, 1.0 - large * large) * grow * self.i_dt[i, axis]
        most = self.integral_limit[i, axis]
        self.integral[i, axis] = limits.within(grown, -most, most)
        return self.p[i, axis] * error + integral - self.d[i, axis] * self.accel[i, axis]
