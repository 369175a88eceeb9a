"""Land detector and take-off ramp of all vehicles, with PX4's conditions and parameters (LNDMC_*).

A vehicle is landed if its thrust is low and it neither moves nor turns for LNDMC_TRIG_TIME. As in PX4, an
invalid horizontal velocity is not compared with its limit: after a collision without external vision, the
estimated velocity can be wrong by several metres per second for minutes. The vertical velocity then comes
from the barometer. A landed vehicle leaves this state when its thrust rises or it moves. A setpoint to climb alone does not end it,
because the motors spool up for a second first.

An armed vehicle takes off when its setpoint is a climb. After COM_SPOOLUP_TIME the allowed climb rate grows
during MPC_TKO_RAMP_T, from no thrust to its full value (MPC_Z_VEL_MAX_UP in OFFBOARD, else MPC_TKO_SPEED).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.param_table import Params
from arena.constants import GRAVITY_M_S2
from arena.kernels.arrays import array, integers, view
from arena.kernels.land_detection import ClimbRequest, LandDetection, RampLaw

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]


class LandDetector:
    """Land detector: decides which of V vehicles are on the ground.

    landed: True if on the ground (V,)
    contact: True if probably on the ground; it is set after one third of LNDMC_TRIG_TIME (V,)
    at_rest: True if landed, and the IMU has measured no motion for LNDMC_TRIG_TIME; no velocity is used (V,)
    """

    def __init__(self, params: Params, vehicles: int) -> None:
        self.params = params
        self.landed, self.contact = np.ones(vehicles, bool), np.ones(vehicles, bool)
        self.at_rest = np.zeros(vehicles, bool)
        self._xy_valid, self._climbing = np.zeros(vehicles, bool), np.zeros(vehicles, bool)
        self._law = law = LandDetection(
            self.landed, self.contact, self.at_rest, self._xy_valid, self._climbing
        )
        self._inputs = tuple(map(array, (law.v_n, law.omega_b, law.force, law.thrust, law.sink)))
        self._read_params()

    def _read_params(self) -> None:
        p, law = self.params, self._law
        self._version = p.version
        array(law.z_vel_max)[:], array(law.xy_vel_max)[:] = p["LNDMC_Z_VEL_MAX"], p["LNDMC_XY_VEL_MAX"]
        array(law.rot_max)[:], array(law.trigger_s)[:] = np.radians(p["LNDMC_ROT_MAX"]), p["LNDMC_TRIG_TIME"]
        array(law.thr_min)[:], array(law.thr_hover)[:] = p["MPC_THR_MIN"], p["MPC_THR_HOVER"]
        array(law.land_speed)[:] = p["MPC_LAND_SPEED"]

    def update(self, now: float, est: Estimator, thrust: Array, climbing: Bool, v_sp_down: Array) -> None:
        """Detect which vehicles are on the ground, and store the result in the attributes.

        now: time since boot [s]
        thrust: collective thrust 0..1 (V,)
        climbing: True if the setpoint is a climb (V,)
        v_sp_down: setpoint of the sink rate [m/s], NaN if there is none (V,)
        """
        if self._version != self.params.version:
            self._read_params()
        values = (est.v_n, est.omega_b, est.specific_force(), thrust, v_sp_down)
        for to, value in zip(self._inputs, values, strict=True):
            to[...] = value
        self._xy_valid[...], self._climbing[...] = est.xy_valid(now), climbing
        self._law.step(now)


class ClimbDetector:
    """Climb detector: decides which of V vehicles are armed and have a setpoint that requires a climb.

    Such a setpoint is a height, a climb rate or a thrust.

    climbing: True if the setpoint is a climb (V,)
    sink: setpoint of the sink rate [m/s], NaN if there is none (V,)
    """

    def __init__(self, params: Params, sp: Setpoints, est: Estimator, v_sp_n: Array) -> None:
        self.params, vehicles = params, len(sp.level)
        self.climbing, self._armed = np.zeros(vehicles, bool), np.zeros(vehicles, bool)
        self._law = law = ClimbRequest(view(est.p_n), view(v_sp_n), self._armed, self.climbing)
        law.read_setpoints_from(integers(sp.level), view(sp.p_n), view(sp.v_n), view(sp.thrust))
        self.sink = array(law.sink)
        self._read_params()

    def _read_params(self) -> None:
        p, law = self.params, self._law
        self._version = p.version
        array(law.thr_min)[:], array(law.thr_hover)[:] = p["MPC_THR_MIN"], p["MPC_THR_HOVER"]

    def update(self, armed: Bool) -> None:
        """Detect which setpoints require a climb, and store the result in the attributes. armed: True if armed (V,)."""
        if self._version != self.params.version:
            self._read_params()
        self._armed[...] = armed
        self._law.update()


class TakeoffRamp:
    """Take-off ramp of V vehicles: raises the allowed climb rate slowly at each take-off.

    flying: True if the take-off is complete (V,)
    begun: start time of the ramp [s], infinite before its start (V,)
    law: the compiled ramp
    """

    def __init__(self, params: Params, vehicles: int) -> None:
        self.params = params
        self.flying = np.zeros(vehicles, bool)
        self._landed, self._climbing, self._offboard = np.zeros((3, vehicles), bool)
        self.law = law = RampLaw(self.flying, self._landed, self._climbing, self._offboard)
        self.begun = array(law.begun)
        self.begun[:] = np.inf
        self._armed_since = array(law.armed_since)
        self._climb_rate = array(law.climb_rate)
        self._read_params()

    def _read_params(self) -> None:
        p, law = self.params, self.law
        self._version = p.version
        array(law.spoolup_s)[:], array(law.ramp_s)[:] = p["COM_SPOOLUP_TIME"], p["MPC_TKO_RAMP_T"]
        array(law.full)[:], array(law.full_offboard)[:] = p["MPC_TKO_SPEED"], p["MPC_Z_VEL_MAX_UP"]
        array(law.start)[:] = -GRAVITY_M_S2 / p["MPC_Z_VEL_P_ACC"]

    def update(self, now: float, armed_since: Array, landed: Bool, climbing: Bool) -> None:
        """Start, advance and end the take-off ramp of each vehicle.

        `begun` is set when the ramp starts, and `flying` when the ramp is complete.

        now: time since boot [s]
        armed_since: time of arming [s], infinite while disarmed (V,)
        landed: True if the land detector detects the ground (V,)
        climbing: True if the setpoint is a climb (V,)
        """
        if self._version != self.params.version:
            self._read_params()
        self._armed_since[...], self._landed[...], self._climbing[...] = armed_since, landed, climbing
        self.law.update(now)

    def climb_rate_limit(self, now: float, offboard: Bool) -> Array:
        """Return the present limit of the climb rate [m/s] (V,).

        The next call overwrites the array.

        Before the ramp the limit is so negative that the position controller commands no thrust. During the ramp the
        limit rises to MPC_Z_VEL_MAX_UP in OFFBOARD, else to MPC_TKO_SPEED. After the take-off it is infinite.

        offboard: True in OFFBOARD (V,)
        """
        if self._version != self.params.version:
            self._read_params()
        self._offboard[...] = offboard
        self.law.limit(now)
        return self._climb_rate
