"""Position, attitude and rate controller in one call (a cascade).

The level of a setpoint is the controller that receives the setpoint. The setpoint of each later controller is the output of
the controller before it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats, Integers
    from arena.kernels.attitude_control import AttitudeLaw
    from arena.kernels.position_control import PositionLaw
    from arena.kernels.rate_control import RateLaw

ATTITUDE, POSITION = 2, 3
"""Levels of a setpoint: the controller that receives the setpoint."""


class CascadeLaw:
    """Position, attitude and rate controller of V vehicles.

    level: controller that receives each vehicle's setpoint: POSITION, ATTITUDE, or less for the rate controller (V,)
    q_nb, omega_b, thrust: given setpoints of attitude wxyz (V, 4), body rates [rad/s] [FRD] (V, 3) and collective
        thrust 0..1 (V,)
    yaw_rate: yaw rate given with a position setpoint, NaN if not given [rad/s] (V,)
    yaw_rate_ff: yaw rate that is used otherwise: given with an attitude setpoint, else 0 [rad/s] (V,)
    selected_thrust: output: collective thrust 0..1 (V,)
    """

    def __init__(
        self, position: PositionLaw, attitude: AttitudeLaw, rate: RateLaw, selected_thrust: Floats
    ) -> None:
        self.position, self.attitude, self.rate = position, attitude, rate
        self.selected_thrust = selected_thrust

    def read_setpoints_from(
        self,
        level: Integers,
        q_nb: Floats,
        omega_b: Floats,
        thrust: Floats,
        yaw_rate: Floats,
        yaw_rate_ff: Floats,
    ) -> None:
        """Store the arrays from which `step` reads the setpoints of attitude, body rates and thrust."""
        self.level, self.q_nb, self.omega_b, self.thrust = level, q_nb, omega_b, thrust
        self.yaw_rate, self.yaw_rate_ff = yaw_rate, yaw_rate_ff

    def step(self, with_position: bool) -> None:
        """Run the controllers of all vehicles for one time step.

        with_position: run the position controller, too. It runs less often than the other controllers.
        """
        if with_position:
            self.position.step()
            for i in range(len(self.level)):
                self._select_attitude(i)
        for i in range(len(self.level)):
            given = self.level[i] == POSITION and math.isfinite(self.yaw_rate[i])
            self.attitude.yaw_rate[i] = self.yaw_rate[i] if given else self.yaw_rate_ff[i]
        self.attitude.step()
        for i in range(len(self.level)):
            for axis in range(3):
                given_rate, rate = self.omega_b[i, axis], self.attitude.rates[i, axis]
                self.rate.omega_sp[i, axis] = rate if self.level[i] >= ATTITUDE else given_rate
        self.rate.step()

    def _select_attitude(self, i: int) -> None:
        """Select attitude and thrust setpoint of vehicle i: from the position controller, or as commanded.

        They are the output of the position controller if the vehicle has a position setpoint. Otherwise they
        are `q_nb` and `thrust`.
        """
        by_position = self.level[i] == POSITION
        self.selected_thrust[i] = self.position.thrust[i] if by_position else self.thrust[i]
        for k in range(4):
            self.attitude.q_sp[i, k] = self.position.q_sp[i, k] if by_position else self.q_nb[i, k]
