"""Setpoints for the modes HOLD, TAKEOFF, LAND and DESCEND, for one vehicle at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.flight_modes import Mode
from arena.autopilot.param_table import Params

_NAN3 = (math.nan, math.nan, math.nan)


@dataclass(slots=True)
class FlightTask:
    """Setpoint generator of one vehicle for the modes HOLD, TAKEOFF, LAND and DESCEND.

    row: row of the vehicle in the arrays over all vehicles
    mode: mode that this task flies; None while the vehicle flies in a mode that is not one of these four
    target, yaw: target position [m] [NED] and heading [rad]
    reached: True if the climb of TAKEOFF is complete
    """

    row: int
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
        """Begin HOLD, TAKEOFF, LAND or DESCEND, and set the position to which the vehicle flies in this mode.

        In TAKEOFF this is a point at the take-off height. In the other modes it is the point at which the
        vehicle can stop.

        takeoff_d: height of the take-off target [m] [NED down], NaN for MIS_TAKEOFF_ALT
        """
        i = self.row
        p, v = est.p_n[i].tolist(), est.v_n[i].tolist()
        stop = 0.0 if landed else math.hypot(v[0], v[1]) / (2.0 * float(params["MPC_ACC_HOR"][i]))
        down = p[2] if landed else p[2] + v[2] * abs(v[2]) / (2.0 * float(params["MPC_ACC_UP_MAX"][i]))
        if mode is Mode.TAKEOFF:
            down = takeoff_d if math.isfinite(takeoff_d) else p[2] - float(params["MIS_TAKEOFF_ALT"][i])
        self.mode, self.yaw, self.reached = mode, yaw, False
        self.target = (p[0] + v[0] * stop, p[1] + v[1] * stop, down)

    def fly(
        self, sp: Setpoints, est: Estimator, params: Params, *, landed: bool, ground_d: float = 0.0
    ) -> None:
        """Compute the setpoint of the vehicle for the current mode, and store it in `sp`.

        ground_d: height of the home position [m] [NED down], 0 if no home is set
        """
        i = self.row
        n, e, d = self.target
        if self.mode is Mode.LAND:
            speed = landing_speed(ground_d - float(est.p_n[i, 2]), params, i)
            sp.set_position(i, p_n=(n, e, math.nan), v_n=(0.0, 0.0, speed), yaw=self.yaw)
        elif self.mode is Mode.DESCEND:
            # Without a position the vehicle brakes while its velocity is known from the inertial sensors,
            # then stays level.
            horizontal = 0.0 if est.velocity_known(i) else math.nan
            sp.set_position(
                i,
                v_n=(horizontal, horizontal, float(params["MPC_LAND_SPEED"][i])),
                a_n=(0.0, 0.0, math.nan),
                yaw=math.nan,
            )
        elif self.mode is Mode.TAKEOFF:
            self._climb(sp, est, params)
        elif landed:
            sp.set_position(i, p_n=_NAN3, v_n=(0.0, 0.0, 0.3), yaw=self.yaw)
        else:
            sp.set_position(i, p_n=(n, e, d), v_n=(0.0, 0.0, 0.0), yaw=self.yaw)

    def _climb(self, sp: Setpoints, est: Estimator, params: Params) -> None:
        i = self.row
        left = float(est.p_n[i, 2]) - self.target[2]
        speed = min(float(params["MPC_TKO_SPEED"][i]), max(left, 0.0) * 1.0 + 0.05)
        self.reached = left < 0.1
        sp.set_position(
            i, p_n=(self.target[0], self.target[1], math.nan), v_n=(0.0, 0.0, -speed), yaw=self.yaw
        )


def landing_speed(height_m: float, params: Params, i: int) -> float:
    """Return the sink rate of an automatic landing of vehicle i [m/s], as in PX4.

    Above MPC_LAND_ALT1 it is MPC_Z_VEL_MAX_DN, below MPC_LAND_ALT2 MPC_LAND_SPEED, and linear between them.
    PX4 uses MPC_LAND_ALT3 and MPC_LAND_CRWL only with a distance sensor, which no simulated vehicle has.

    height_m: height above home [m]
    """
    low, high = float(params["MPC_LAND_ALT2"][i]), float(params["MPC_LAND_ALT1"][i])
    slow, fast = float(params["MPC_LAND_SPEED"][i]), float(params["MPC_Z_VEL_MAX_DN"][i])
    if height_m <= low:
        return slow
    return fast if height_m > high else slow + (fast - slow) * (height_m - low) / (high - low)


def stop_motors(sp: Setpoints, i: int) -> None:
    """Stop the motors of vehicle i: remove its setpoint."""
    sp.clear(i)
