"""Land detector and take-off ramp, batched. What PX4's land detector asks, with its parameters (LNDMC_*).

On the ground means, for LNDMC_TRIG_TIME: motors told to do little, not moving, not turning. Armed and told to climb is taking
off: after COM_SPOOLUP_TIME the allowed climb rate grows from "no thrust at all" to its full value over MPC_TKO_RAMP_T: in
OFFBOARD MPC_Z_VEL_MAX_UP, else MPC_TKO_SPEED.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.param_table import Params
from arena.constants import GRAVITY_M_S2

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]

_LOW_THRUST = 0.3  # of the way from MPC_THR_MIN to hover: what "little" is


class LandDetector:
    """landed: on the ground, settled (V,). contact: probably on the ground, while descending (V,)."""

    def __init__(self, params: Params, vehicles: int) -> None:
        self.params = params
        self.landed = np.ones(vehicles, bool)
        self.contact = np.ones(vehicles, bool)
        self._since = np.zeros(vehicles)

    def update(self, now: float, est: Estimator, thrust: Array, flying_up: Bool, v_sp_down: Array) -> None:
        """thrust: collective 0..1 (V,); flying_up: told to climb (V,); v_sp_down: commanded sink [m/s] (V,), NaN when free."""
        p = self.params
        low = p["MPC_THR_MIN"] + _LOW_THRUST * (p["MPC_THR_HOVER"] - p["MPC_THR_MIN"])
        vertical = np.abs(est.v_n[:, 2]) < p["LNDMC_Z_VEL_MAX"]
        still = vertical & (np.hypot(est.v_n[:, 0], est.v_n[:, 1]) < p["LNDMC_XY_VEL_MAX"])
        quiet = np.abs(est.omega_b).max(1) < np.radians(p["LNDMC_ROT_MAX"])
        sinking_in_vain = (
            vertical & (v_sp_down > 0.5 * p["MPC_LAND_SPEED"]) & (thrust < 0.9 * p["MPC_THR_HOVER"])
        )
        resting = ~flying_up & (
            quiet & still & ((thrust <= low) | sinking_in_vain) | (thrust < 0.01) & vertical
        )
        self._since = np.where(resting, self._since, now)
        held = now - self._since
        trigger = p["LNDMC_TRIG_TIME"]
        self.contact = held > trigger / 3.0
        self.landed = np.where(self.landed, resting | ~flying_up & (thrust <= low), held > trigger)


class TakeoffRamp:
    """flying: through with taking off (V,)."""

    def __init__(self, params: Params, vehicles: int) -> None:
        self.params = params
        self.flying = np.zeros(vehicles, bool)
        self.begun = np.full(vehicles, np.inf)

    def update(self, now: float, armed_since: Array, landed: Bool, wants_up: Bool) -> None:
        """armed_since: [s], inf while disarmed (V,)."""
        spooled = now - armed_since >= self.params["COM_SPOOLUP_TIME"]
        go = spooled & wants_up
        self.begun = np.where(
            landed & ~go & ~self.flying | ~spooled, np.inf, np.minimum(self.begun, np.where(go, now, np.inf))
        )
        done = now - self.begun >= self.params["MPC_TKO_RAMP_T"]
        self.flying = spooled & (self.flying & ~landed | done & wants_up)

    def speed_up(self, now: float, full: Array) -> Array:
        """The climb rate allowed now [m/s] (V,); negative so early that not even the weight is carried. full: the rate that
        the ramp ends with [m/s] (V,).
        """
        p = self.params
        part = np.clip((now - self.begun) / np.maximum(p["MPC_TKO_RAMP_T"], 1e-3), 0.0, 1.0)
        start = -GRAVITY_M_S2 / p["MPC_Z_VEL_P_ACC"]
        ramp = start + part * (full - start)
        return np.where(self.flying, np.inf, np.where(np.isfinite(self.begun), ramp, start))


def wants_up(sp: Setpoints, est: Estimator, params: Params) -> Bool:
    """Is each vehicle told to leave the floor? By height, climb rate or thrust. (V,)"""
    by_height = sp.p_n[:, 2] - est.p_n[:, 2] < -0.1  # which what is not given is not
    by_speed = sp.v_n[:, 2] < -0.1
    by_thrust = sp.thrust > params["MPC_THR_MIN"] + 0.5 * (params["MPC_THR_HOVER"] - params["MPC_THR_MIN"])
    return np.asarray(np.where(sp.at(Level.POSITION), by_height | by_speed, ~sp.at(Level.NONE) & by_thrust))
