"""What each vehicle of the fleet is asked to do, as arrays. NaN means "not given"."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]


class Level(IntEnum):
    """Where a setpoint enters the cascade."""

    NONE = 0  # motors off
    RATE = 1  # omega_b and thrust
    ATTITUDE = 2  # q_nb and thrust
    POSITION = 3  # position, velocity and acceleration, each axis where finite


class Setpoints:
    """One row per vehicle.

    p_n [m] [NED] (V, 3), v_n [m/s] (V, 3), a_n [m/s2] (V, 3), yaw [rad] (V,), yaw_rate [rad/s] (V,);
    q_nb [-] wxyz (V, 4), omega_b [rad/s] [FRD] (V, 3), thrust 0..1 collective, up [-] (V,).
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

    def at(self, level: Level) -> Bool:
        """Which vehicles have a setpoint of this level (V,). Compared as plain numbers: numpy is slow with enums."""
        return np.asarray(self.level == level.value)

    def clear(self, i: int) -> None:
        """Vehicle i has no setpoint: motors off if it were flown."""
        self.level[i] = Level.NONE
        self.p_n[i] = self.v_n[i] = self.a_n[i] = np.nan
        self.yaw[i] = self.yaw_rate[i] = np.nan
        self.thrust[i] = 0.0

    def fly(
        self,
        i: int,
        *,
        p_n: object = np.nan,
        v_n: object = np.nan,
        a_n: object = np.nan,
        yaw: float = np.nan,
        yaw_rate: float = np.nan,
    ) -> None:
        """A setpoint of the position level for vehicle i; what is left out is not controlled."""
        self.level[i] = Level.POSITION
        self.p_n[i], self.v_n[i], self.a_n[i] = p_n, v_n, a_n
        self.yaw[i], self.yaw_rate[i] = yaw, yaw_rate
