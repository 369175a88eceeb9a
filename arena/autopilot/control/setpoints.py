"""Setpoints of the controllers: arrays over all vehicles, and the setpoint of one vehicle in OFFBOARD.

NaN means that a value is not given.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from arena.kernels.arrays import integers, view
from arena.kernels.setpoint_rows import SetpointRows

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]
Triple = tuple[float, float, float]
_NAN = math.nan


class Level(IntEnum):
    """Kind of setpoint, named after the controller that uses it: position, attitude or rate."""

    NONE = 0  # motors off
    RATE = 1  # omega_b and thrust
    ATTITUDE = 2  # q_nb and thrust
    POSITION = 3  # position, velocity and acceleration; axes with NaN are not controlled


class OffboardSetpoint(NamedTuple):
    """Setpoint for one vehicle, received by MAVLink from a program that uses OFFBOARD mode.

    level: controller that receives the setpoint. POSITION uses p_n, v_n, a_n, yaw, yaw_rate; ATTITUDE uses q_nb, yaw_rate,
        thrust; RATE uses omega_b, thrust
    p_n, v_n, a_n: position [m], velocity [m/s], acceleration [m/s2] [NED]
    yaw, yaw_rate: heading [rad] and its rate [rad/s]
    q_nb: attitude [-] wxyz
    omega_b: body rates [rad/s] [FRD]
    thrust: collective thrust 0..1
    """

    level: Level
    p_n: Triple = (_NAN, _NAN, _NAN)
    v_n: Triple = (_NAN, _NAN, _NAN)
    a_n: Triple = (_NAN, _NAN, _NAN)
    yaw: float = _NAN
    yaw_rate: float = _NAN
    q_nb: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    omega_b: Triple = (0.0, 0.0, 0.0)
    thrust: float = 0.0

    @property
    def needs_position(self) -> bool:
        """True if the setpoint contains a position or velocity, and so needs a valid position estimate."""
        if self.level is not Level.POSITION:
            return False
        (x, y, z), (vx, vy, vz), known = self.p_n, self.v_n, math.isfinite
        return known(x) or known(y) or known(z) or known(vx) or known(vy) or known(vz)


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
        self._rows = SetpointRows(
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

    def has_level(self, level: Level) -> Bool:
        """Return a mask (V,) of the vehicles whose setpoint has this level, for example `Level.RATE` (body rates)."""
        return np.asarray(self.level == level.value)  # as int: numpy is slow with enums

    def clear(self, i: int) -> None:
        """Remove the setpoint of vehicle i; its motors stop."""
        self.level[i] = Level.NONE
        self.p_n[i] = self.v_n[i] = self.a_n[i] = np.nan
        self.yaw[i] = self.yaw_rate[i] = np.nan
        self.thrust[i] = self.yaw_rate_ff[i] = 0.0

    def follow(self, i: int, o: OffboardSetpoint) -> None:
        """Write an offboard setpoint of vehicle i."""
        level = o.level.value
        self._rows.set_position(i, level, o.p_n, o.v_n, o.a_n, o.yaw, o.yaw_rate)
        ff = o.yaw_rate if level == Level.ATTITUDE.value else 0.0
        self._rows.set_attitude(i, o.q_nb, o.omega_b, o.thrust, ff)

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
