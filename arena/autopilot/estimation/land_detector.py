"""Land detector and take-off ramp, batched over vehicles, with PX4's conditions and parameters (LNDMC_*).

A vehicle is landed if its thrust is low and it neither moves nor turns for LNDMC_TRIG_TIME. As in PX4, an
invalid horizontal velocity is not compared with its limit. After a collision without external vision it can
be wrong by several metres per second for minutes. The vertical velocity comes from the barometer then.

An armed vehicle takes off when its setpoint is a climb. After COM_SPOOLUP_TIME the allowed climb rate grows
for MPC_TKO_RAMP_T, from no thrust to its full value (MPC_Z_VEL_MAX_UP in OFFBOARD, else MPC_TKO_SPEED).
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

_LOW_THRUST = 0.3  # share of the way from MPC_THR_MIN to MPC_THR_HOVER
_FREEFALL_M_S2 = 2.0  # below this specific force the vehicle falls
_REST_M_S2 = 0.5  # largest difference of the specific force from gravity at rest


class LandDetector:
    """Land detector: decides which of V vehicles are on the ground.

    landed: True if on the ground (V,)
    contact: True if probably on the ground; it is set after one third of LNDMC_TRIG_TIME (V,)
    at_rest: True if landed, and the IMU has measured no motion for LNDMC_TRIG_TIME; no velocity is used (V,)
    """

    def __init__(self, params: Params, vehicles: int) -> None:
        self.params = params
        self.landed = np.ones(vehicles, bool)
        self.contact = np.ones(vehicles, bool)
        self.at_rest = np.zeros(vehicles, bool)
        self._since = np.zeros(vehicles)
        self._at_rest_since = np.zeros(vehicles)

    def update(self, now: float, est: Estimator, thrust: Array, climbing: Bool, v_sp_down: Array) -> None:
        """Detect from estimate and setpoints which vehicles are on the ground, and store the result in the attributes.

        now: time since boot [s]
        thrust: collective thrust 0..1 (V,)
        climbing: True if the setpoint is a climb (V,)
        v_sp_down: setpoint of the sink rate [m/s], NaN if there is none (V,)
        """
        p = self.params
        low = p["MPC_THR_MIN"] + _LOW_THRUST * (p["MPC_THR_HOVER"] - p["MPC_THR_MIN"])
        vertical = np.abs(est.v_n[:, 2]) < p["LNDMC_Z_VEL_MAX"]
        moving = est.xy_valid(now) & (np.hypot(est.v_n[:, 0], est.v_n[:, 1]) >= p["LNDMC_XY_VEL_MAX"])
        quiet = np.abs(est.omega_b).max(1) < np.radians(p["LNDMC_ROT_MAX"])
        force = est.specific_force()
        pressed_down = (
            vertical & (v_sp_down > 0.5 * p["MPC_LAND_SPEED"]) & (thrust < 0.9 * p["MPC_THR_HOVER"])
        )
        still = vertical & ~moving & (force > _FREEFALL_M_S2)
        resting = ~climbing & (quiet & still & ((thrust <= low) | pressed_down) | (thrust < 0.01) & vertical)
        self._since = np.where(resting, self._since, now)
        held = now - self._since
        trigger = p["LNDMC_TRIG_TIME"]
        self.contact = held > trigger / 3.0
        self.landed = np.where(self.landed, resting | ~climbing & (thrust <= low), held > trigger)
        rest = self.landed & quiet & (np.abs(force - GRAVITY_M_S2) < _REST_M_S2)
        self._at_rest_since = np.where(rest, self._at_rest_since, now)
        self.at_rest = now - self._at_rest_since > trigger


class TakeoffRamp:
    """Take-off ramp of V vehicles: raises the allowed climb rate slowly at each take-off.

    flying: True if the take-off is complete (V,)
    begun: start time of the ramp [s], infinite before its start (V,)
    """

    def __init__(self, params: Params, vehicles: int) -> None:
        self.params = params
        self.flying = np.zeros(vehicles, bool)
        self.begun = np.full(vehicles, np.inf)

    def update(self, now: float, armed_since: Array, landed: Bool, climbing: Bool) -> None:
        """Update the take-off ramp of each vehicle: set `begun` when the ramp starts, and `flying` when the ramp is complete.

        now: time since boot [s]
        armed_since: time of arming [s], infinite while disarmed (V,)
        landed: True if the land detector detects the ground (V,)
        climbing: True if the setpoint is a climb (V,)
        """
        spooled = now - armed_since >= self.params["COM_SPOOLUP_TIME"]
        go = spooled & climbing
        self.begun = np.where(
            landed & ~go & ~self.flying | ~spooled, np.inf, np.minimum(self.begun, np.where(go, now, np.inf))
        )
        done = now - self.begun >= self.params["MPC_TKO_RAMP_T"]
        self.flying = spooled & (self.flying & ~landed | done & climbing)

    def speed_up(self, now: float, full: Array) -> Array:
        """Return the greatest climb rate [m/s] (V,) that the take-off ramp allows now. During the ramp this rate
        rises from a negative value (no thrust) to `full`.

        full: climb rate at the end of the ramp [m/s] (V,)
        """
        p = self.params
        part = np.clip((now - self.begun) / np.maximum(p["MPC_TKO_RAMP_T"], 1e-3), 0.0, 1.0)
        start = -GRAVITY_M_S2 / p["MPC_Z_VEL_P_ACC"]
        ramp = start + part * (full - start)
        return np.where(self.flying, np.inf, np.where(np.isfinite(self.begun), ramp, start))


def climb_requested(sp: Setpoints, est: Estimator, params: Params) -> Bool:
    """Return a mask (V,) of the vehicles whose setpoint (height, climb rate or thrust) requires a climb."""
    by_height = (
        sp.p_n[:, 2] - est.p_n[:, 2] < -0.1
    )  # NaN compares false, so axes without a setpoint are ignored
    by_speed = sp.v_n[:, 2] < -0.1
    by_thrust = sp.thrust > params["MPC_THR_MIN"] + 0.5 * (params["MPC_THR_HOVER"] - params["MPC_THR_MIN"])
    return np.asarray(np.where(sp.at(Level.POSITION), by_height | by_speed, ~sp.at(Level.NONE) & by_thrust))
