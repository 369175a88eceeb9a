"""Land detector and take-off ramp, with PX4's conditions.

`arena.autopilot.estimation.land_detector` explains the conditions.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from arena.constants import GRAVITY_M_S2
from arena.kernels import limits
from arena.kernels.arrays import flags, floats

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats, Integers

    Mask = NDArray[np.bool_]

_G = GRAVITY_M_S2
_LOW_THRUST = 0.3  # share of the way from MPC_THR_MIN to MPC_THR_HOVER
_FREEFALL_M_S2 = 2.0  # below this specific force the vehicle falls
_NONE, _POSITION = 0, 3  # levels of a setpoint, as in `cascade`
_UPWARD = 0.1  # least distance [m] and rate [m/s] of a setpoint to climb
_NAN = float("nan")
_REST_M_S2 = 0.5  # largest difference of the specific force from gravity at rest


class LandDetection:
    """Land detector of V vehicles.

    v_n, omega_b, force: input: velocity [m/s] [NED] (V, 3), body rates [rad/s] [FRD] (V, 3), magnitude of the mean
        specific force [m/s2] (V,)
    xy_valid, climbing: input: whether the horizontal velocity is valid, whether the setpoint is a climb (V,)
    thrust, sink: input: collective thrust 0..1, setpoint of the sink rate [m/s], NaN for none (V,)
    z_vel_max, xy_vel_max, rot_max, trigger_s: LNDMC_Z_VEL_MAX, LNDMC_XY_VEL_MAX [m/s], LNDMC_ROT_MAX [rad/s],
        LNDMC_TRIG_TIME [s] (V,)
    thr_min, thr_hover, land_speed: MPC_THR_MIN, MPC_THR_HOVER, MPC_LAND_SPEED [m/s] (V,)
    landed, contact, at_rest: output, see `LandDetector` (V,)
    """

    def __init__(self, landed: Mask, contact: Mask, at_rest: Mask, xy_valid: Mask, climbing: Mask) -> None:
        v, self.landed, self.contact, self.at_rest = (
            len(landed),
            flags(landed),
            flags(contact),
            flags(at_rest),
        )
        self.xy_valid, self.climbing = flags(xy_valid), flags(climbing)
        self.v_n, self.omega_b, self.force = floats(v, 3), floats(v, 3), floats(v)
        self.thrust, self.sink = floats(v), floats(v)
        self.z_vel_max, self.xy_vel_max, self.rot_max = floats(v), floats(v), floats(v)
        self.trigger_s, self.thr_min, self.thr_hover, self.land_speed = (
            floats(v),
            floats(v),
            floats(v),
            floats(v),
        )
        self.since, self.at_rest_since = floats(v), floats(v)

    def step(self, now: float) -> None:
        """Decide for each vehicle whether it is on the ground.

        now: time since boot [s]
        """
        for i in range(len(self.force)):
            resting = self._is_resting(i)
            if not resting:
                self.since[i] = now
            held = now - self.since[i]
            low = self._has_low_thrust(i)
            self.contact[i] = held > self.trigger_s[i] / 3.0
            if self.landed[i]:
                self.landed[i] = resting or low
            else:
                self.landed[i] = held > self.trigger_s[i]
            if not (self.landed[i] and self._is_quiet(i) and abs(self.force[i] - _G) < _REST_M_S2):
                self.at_rest_since[i] = now
            self.at_rest[i] = now - self.at_rest_since[i] > self.trigger_s[i]

    def _is_resting(self, i: int) -> bool:
        """Return whether vehicle i has the thrust and the motion of a vehicle on the ground."""
        vertical = abs(self.v_n[i, 2]) < self.z_vel_max[i]
        if self.climbing[i] or not vertical:
            return False
        if self.thrust[i] < 0.01:
            return True
        slow = limits.length(self.v_n[i, 0], self.v_n[i, 1]) < self.xy_vel_max[i] or not self.xy_valid[i]
        if not (slow and self._is_quiet(i) and self.force[i] > _FREEFALL_M_S2):
            return False
        pressed = self.sink[i] > 0.5 * self.land_speed[i] and self.thrust[i] < 0.9 * self.thr_hover[i]
        return self._has_low_thrust(i) or pressed

    def _is_quiet(self, i: int) -> bool:
        """Return whether all angular rates of vehicle i are small."""
        fastest = max(abs(self.omega_b[i, 0]), abs(self.omega_b[i, 1]), abs(self.omega_b[i, 2]))
        return fastest < self.rot_max[i]

    def _has_low_thrust(self, i: int) -> bool:
        return self.thrust[i] <= self.thr_min[i] + _LOW_THRUST * (self.thr_hover[i] - self.thr_min[i])


class ClimbRequest:
    """Detection of setpoints that require a climb, for V vehicles.

    p_n: estimated position [m] [NED] (V, 3).  v_sp_n: velocity setpoint of the position controller [m/s] [NED] (V, 3)
    armed: input: whether the vehicle is armed (V,)
    thr_min, thr_hover: MPC_THR_MIN, MPC_THR_HOVER (V,)
    climbing: output: whether an armed vehicle's setpoint (height, climb rate or thrust) requires a climb (V,)
    sink: output: setpoint of the sink rate [m/s], NaN for none (V,)
    """

    def __init__(self, p_n: Floats, v_sp_n: Floats, armed: Mask, climbing: Mask) -> None:
        v, self.p_n, self.v_sp_n = len(armed), p_n, v_sp_n
        self.armed, self.climbing, self.sink = flags(armed), flags(climbing), floats(v)
        self.thr_min, self.thr_hover = floats(v), floats(v)

    def read_setpoints_from(self, level: Integers, p_n: Floats, v_n: Floats, thrust: Floats) -> None:
        """Store the arrays from which `update` reads the setpoints.

        level: controller that receives the setpoint (V,).  p_n, v_n: position [m], velocity [m/s] [NED] (V, 3)
        thrust: collective thrust 0..1 (V,)
        """
        self.level, self.sp_p_n, self.sp_v_n, self.sp_thrust = level, p_n, v_n, thrust

    def update(self) -> None:
        """Detect for each vehicle whether its setpoint requires a climb."""
        for i in range(len(self.sink)):
            positioned = self.level[i] == _POSITION
            self.sink[i] = self.v_sp_n[i, 2] if positioned else _NAN
            self.climbing[i] = self.armed[i] != 0 and (
                self._is_upward(i) if positioned else self.level[i] != _NONE and self._has_thrust(i)
            )

    def _is_upward(self, i: int) -> bool:
        # NaN compares false, so axes without a setpoint are ignored
        return self.sp_p_n[i, 2] - self.p_n[i, 2] < -_UPWARD or self.sp_v_n[i, 2] < -_UPWARD

    def _has_thrust(self, i: int) -> bool:
        return self.sp_thrust[i] > self.thr_min[i] + 0.5 * (self.thr_hover[i] - self.thr_min[i])


class RampLaw:
    """Take-off ramp of V vehicles: from the first climb setpoint on, the limit of the climb rate rises slowly.

    armed_since: input: time of arming [s], infinite while disarmed (V,)
    landed, climbing: input: whether on the ground, whether the setpoint is a climb (V,)
    offboard: input: whether in OFFBOARD (V,)
    full, full_offboard: climb rate at the end of the ramp, MPC_TKO_SPEED, and MPC_Z_VEL_MAX_UP in OFFBOARD [m/s] (V,)
    spoolup_s, ramp_s: COM_SPOOLUP_TIME, MPC_TKO_RAMP_T [s] (V,)
    start: climb rate at the begin of the ramp: no thrust [m/s] (V,)
    flying, begun: output, see `TakeoffRamp` (V,)
    climb_rate: output of `limit`: greatest climb rate now [m/s] (V,)
    """

    def __init__(self, flying: Mask, landed: Mask, climbing: Mask, offboard: Mask) -> None:
        v, self.flying, self.landed = len(flying), flags(flying), flags(landed)
        self.climbing, self.offboard = flags(climbing), flags(offboard)
        self.armed_since, self.spoolup_s, self.ramp_s = floats(v), floats(v), floats(v)
        self.full, self.full_offboard = floats(v), floats(v)
        self.start, self.begun, self.climb_rate = floats(v), floats(v), floats(v)

    def update(self, now: float) -> None:
        """Start, advance and end the take-off ramps of all vehicles.

        now: time since boot [s]
        """
        for i in range(len(self.begun)):
            spooled = now - self.armed_since[i] >= self.spoolup_s[i]
            go = spooled and self.climbing[i]
            if not spooled or (self.landed[i] and not go and not self.flying[i]):
                self.begun[i] = math.inf
            elif go:
                self.begun[i] = min(self.begun[i], now)
            done = now - self.begun[i] >= self.ramp_s[i]
            if self.flying[i]:
                self.flying[i] = spooled and (not self.landed[i] or (done and self.climbing[i]))
            else:
                self.flying[i] = spooled and done and self.climbing[i]

    def limit(self, now: float) -> None:
        """Compute the largest climb rate that the take-off ramp now allows each vehicle.

        now: time since boot [s]
        """
        for i in range(len(self.begun)):
            part = limits.within((now - self.begun[i]) / max(self.ramp_s[i], 1e-3), 0.0, 1.0)
            full = self.full_offboard[i] if self.offboard[i] else self.full[i]
            self.climb_rate[i] = self.start[i] + part * (full - self.start[i])
            if self.flying[i]:
                self.climb_rate[i] = math.inf
