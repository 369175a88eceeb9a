"""Setpoints of the controllers: arrays over all vehicles.

NaN means that a value is not given.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from arena.kernels.arrays import integers, view
from arena.kernels.offboard_setpoints import OffboardSetpoints

Array = NDArray[np.float64]


class Level(IntEnum):
    """Kind of setpoint, named after the controller that uses it: position, attitude or rate."""

    NONE = 0  # motors off
    RATE = 1  # omega_b and thrust
    ATTITUDE = 2  # q_nb and thrust
    POSITION = 3  # position, velocity and acceleration; axes with NaN are not controlled


class Setpoints:
    """Setpoints of V vehicles, one row per vehicle.

    level: controller that receives the setpoint, a `Level` (V,)
    p_n, v_n, a_n: position [m], velocity [m/s], acceleration [m/s2] [NED] (V, 3)
    yaw, yaw_rate: heading [rad] and its rate [rad/s] (V,)
    q_nb: attitude [-] wxyz (V, 4)
    omega_b: body rates [rad/s] [FRD] (V, 3)
    thrust: collective thrust 0..1 (V,)
    yaw_rate_ff: yaw rate that is added after the attitude controller [rad/s] (V,)
    """

    def __init__(self, vehicles: int) -> None:
        v = vehicles
        self.level = np.full(v, int(Level.NONE))
        self.p_n, self.v_n, self.a_n = (
            np.full((v, 3), np.nan),
            np.full((v, 3), np.nan),
            np.full((v, 3), np.nan),
        )
        self.yaw, self.yaw_rate = np.full(v, np.nan), np.full(v, np.nan)
        self.q_nb, self.omega_b = np.tile([1.0, 0.0, 0.0, 0.0], (v, 1)), np.zeros((v, 3))
        self.thrust = np.zeros(v)
        self.yaw_rate_ff = np.zeros(v)

    def offboard_setpoints(self, q_nb: Array) -> OffboardSetpoints:
        """Return a new store of received setpoints. It copies the setpoint of a vehicle in OFFBOARD into these arrays.

        q_nb: estimated attitudes [-] wxyz (V, 4)
        """
        store = OffboardSetpoints(view(q_nb))
        store.write_setpoints_to(
            integers(self.level),
            view(self.p_n),
            view(self.v_n),
            view(self.a_n),
            view(self.yaw),
            view(self.yaw_rate),
            view(self.q_nb),
            view(self.omega_b),
            view(self.thrust),
            view(self.yaw_rate_ff),
        )
        return store

    def clear(self, i: int) -> None:
        """Remove the setpoint of vehicle i; its motors stop."""
        self.level[i] = Level.NONE
        self.p_n[i] = self.v_n[i] = self.a_n[i] = np.nan
        self.yaw[i] = self.yaw_rate[i] = np.nan
        self.thrust[i] = self.yaw_rate_ff[i] = 0.0

    def set_position(
        self,
        i: int,
        *,
        p_n: object = np.nan,
        v_n: object = np.nan,
        a_n: object = np.nan,
        yaw: float = np.nan,
        yaw_rate: float = np.nan,
    ) -> None:
        """Write a position, velocity or acceleration setpoint of vehicle i, for its position controller.

        Axes and values left as NaN are not controlled. A yaw rate of an earlier attitude setpoint ends.
        """
        self.level[i] = Level.POSITION
        self.p_n[i], self.v_n[i], self.a_n[i] = p_n, v_n, a_n
        self.yaw[i], self.yaw_rate[i], self.yaw_rate_ff[i] = yaw, yaw_rate, 0.0
