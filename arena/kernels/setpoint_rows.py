"""Rows of the setpoint arrays of all vehicles: writes the setpoint of one vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats, Integers

    Triple = tuple[float, float, float]
    Quaternion = tuple[float, float, float, float]


class SetpointRows:
    """Writer of the arrays of `arena.autopilot.control.setpoints.Setpoints`, which describes them."""

    def __init__(
        self,
        level: Integers,
        p_n: Floats,
        v_n: Floats,
        a_n: Floats,
        yaw: Floats,
        yaw_rate: Floats,
        q_nb: Floats,
        omega_b: Floats,
        thrust: Floats,
        yaw_rate_ff: Floats,
    ) -> None:
        self.level, self.p_n, self.v_n, self.a_n = level, p_n, v_n, a_n
        self.yaw, self.yaw_rate, self.yaw_rate_ff = yaw, yaw_rate, yaw_rate_ff
        self.q_nb, self.omega_b, self.thrust = q_nb, omega_b, thrust

    def set_position(
        self, i: int, level: int, p_n: Triple, v_n: Triple, a_n: Triple, yaw: float, yaw_rate: float
    ) -> None:
        """Write level, position, velocity, acceleration, heading and its rate of vehicle i."""
        self.level[i], self.yaw[i], self.yaw_rate[i] = level, yaw, yaw_rate
        self.p_n[i, 0], self.p_n[i, 1], self.p_n[i, 2] = p_n
        self.v_n[i, 0], self.v_n[i, 1], self.v_n[i, 2] = v_n
        self.a_n[i, 0], self.a_n[i, 1], self.a_n[i, 2] = a_n

    def set_attitude(
        self, i: int, q_nb: Quaternion, omega_b: Triple, thrust: float, yaw_rate_ff: float
    ) -> None:
        """Write attitude, body rates, thrust and the yaw rate after the attitude controller of vehicle i."""
        self.q_nb[i, 0], self.q_nb[i, 1], self.q_nb[i, 2], self.q_nb[i, 3] = q_nb
        self.omega_b[i, 0], self.omega_b[i, 1], self.omega_b[i, 2] = omega_b
        self.thrust[i], self.yaw_rate_ff[i] = thrust, yaw_rate_ff
