"""Attitude controller: computes body rate setpoints from attitude setpoints.

Attitude law: Brescianini, Hehn, D'Andrea, "Nonlinear quadrocopter attitude control", ETH, 2013. It corrects
the tilt first and weights yaw less.
"""

from __future__ import annotations

import math

from arena.kernels import limits, rotations
from arena.kernels.arrays import floats


class AttitudeLaw:
    """Attitude controller of V vehicles.

    gain: roll, pitch, yaw gain; the yaw gain is divided by `yaw_weight` [1/s] (V, 3)
    yaw_weight: MC_YAW_WEIGHT 0..1 (V,)
    rate_limit: limit of each body rate [rad/s] (V, 3)
    q_nb, r_nb: input: attitude [-] wxyz (V, 4) and its rotation matrix (V, 3, 3)
    q_sp: input: attitude setpoint [-] wxyz (V, 4)
    yaw_rate: input: feed-forward rate about the down axis of NED [rad/s] (V,)
    rates: output: body rate setpoint [rad/s] [FRD] (V, 3)
    """

    def __init__(self, vehicles: int) -> None:
        self.gain, self.yaw_weight, self.rate_limit = (
            floats(vehicles, 3),
            floats(vehicles),
            floats(vehicles, 3),
        )
        self.q_nb, self.r_nb, self.q_sp = floats(vehicles, 4), floats(vehicles, 3, 3), floats(vehicles, 4)
        self.yaw_rate, self.rates = floats(vehicles), floats(vehicles, 3)

    def step(self) -> None:
        """Compute the body rate setpoints of all vehicles."""
        for i in range(len(self.yaw_rate)):
            self._update(i)

    def _update(self, i: int) -> None:
        q, q_sp = self.q_nb, self.q_sp
        # The error in body axes is tilt * twist about z; only the twist is weighted, by half its angle. If
        # the two z axes are opposite, the twist is zero and the error is used unweighted.
        w, x, y, z = rotations.between(
            (q[i, 0], q[i, 1], q[i, 2], q[i, 3]), (q_sp[i, 0], q_sp[i, 1], q_sp[i, 2], q_sp[i, 3])
        )
        twice = -2.0 if w < 0.0 else 2.0
        half = math.atan2(z * twice, w * twice)
        kept = self.yaw_weight[i] * half
        cos, sin = twice * math.cos(half - kept), twice * math.sin(half - kept)
        # Limited before the rotation: otherwise a fast yaw rate saturates every body axis and the vehicle
        # rolls over.
        feed = limits.within(self.yaw_rate[i], -self.rate_limit[i, 2], self.rate_limit[i, 2])
        self._set_rate(i, 0, cos * x - sin * y, feed)
        self._set_rate(i, 1, cos * y + sin * x, feed)
        self._set_rate(i, 2, 2.0 * limits.length(w, z) * math.sin(kept), feed)

    def _set_rate(self, i: int, axis: int, error: float, feed: float) -> None:
        """Set the body rate setpoint of vehicle i about one body axis.

        error: attitude error about this axis: twice the element of the error quaternion [-]
        feed: feed-forward rate about the down axis of NED [rad/s]
        """
        most = self.rate_limit[i, axis]
        # The last row of the rotation matrix is the down axis in body axes.
        rate = error * self.gain[i, axis] + self.r_nb[i, 2, axis] * feed
        self.rates[i, axis] = limits.within(rate, -most, most)
