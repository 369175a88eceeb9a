"""What HOLD, TAKEOFF, LAND and DESCEND ask of the cascade: the modes that fly themselves, one vehicle at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.commander import Mode
from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.param_table import Params

Array = NDArray[np.float64]
_NAN3 = (math.nan, math.nan, math.nan)


@dataclass(slots=True)
class Task:
    """The mode that vehicle `i` is flying by itself. target: where to [m] [NED]; reached: the climb is done."""

    i: int
    mode: Mode | None = None
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw: float = 0.0
    reached: bool = False

    def enter(
        self,
        mode: Mode,
        est: Estimator,
        yaw: float,
        params: Params,
        *,
        landed: bool,
        takeoff_d: float = math.nan,
    ) -> None:
        """Fix the point to brake to and the heading. takeoff_d: wanted height [m] [NED down], NaN for MIS_TAKEOFF_ALT."""
        i = self.i
        p, v = est.p_n[i].tolist(), est.v_n[i].tolist()
        stop = 0.0 if landed else math.hypot(v[0], v[1]) / (2.0 * float(params["MPC_ACC_HOR"][i]))
        down = p[2] if landed else p[2] + v[2] * abs(v[2]) / (2.0 * float(params["MPC_ACC_UP_MAX"][i]))
        if mode is Mode.TAKEOFF:
            down = takeoff_d if math.isfinite(takeoff_d) else p[2] - float(params["MIS_TAKEOFF_ALT"][i])
        self.mode, self.yaw, self.reached = mode, yaw, False
        self.target = (p[0] + v[0] * stop, p[1] + v[1] * stop, down)

    def fly(self, sp: Setpoints, est: Estimator, params: Params, *, landed: bool) -> None:
        """Write the setpoint of this moment."""
        i = self.i
        n, e, d = self.target
        if self.mode is Mode.LAND:
            sp.fly(i, p_n=(n, e, math.nan), v_n=(0.0, 0.0, float(params["MPC_LAND_SPEED"][i])), yaw=self.yaw)
        elif self.mode is Mode.DESCEND:
            # No position to hold. It brakes by the velocity that the inertial sensors carry on while that is known, then is
            # level: what is not known nothing chases.
            over_ground = 0.0 if est.velocity_known(i) else math.nan
            sp.fly(
                i,
                v_n=(over_ground, over_ground, float(params["MPC_LAND_SPEED"][i])),
                a_n=(0.0, 0.0, math.nan),
                yaw=math.nan,
            )
        elif self.mode is Mode.TAKEOFF:
            self._climb(sp, est, params)
        elif landed:
            sp.fly(i, p_n=_NAN3, v_n=(0.0, 0.0, 0.3), yaw=self.yaw)
        else:
            sp.fly(i, p_n=(n, e, d), v_n=(0.0, 0.0, 0.0), yaw=self.yaw)

    def _climb(self, sp: Setpoints, est: Estimator, params: Params) -> None:
        i = self.i
        left = float(est.p_n[i, 2]) - self.target[2]
        speed = min(float(params["MPC_TKO_SPEED"][i]), max(left, 0.0) * 1.0 + 0.05)
        self.reached = left < 0.1
        sp.fly(i, p_n=(self.target[0], self.target[1], math.nan), v_n=(0.0, 0.0, -speed), yaw=self.yaw)


def termination(sp: Setpoints, i: int) -> None:
    """Motors off."""
    sp.clear(i)
    sp.level[i] = Level.NONE
