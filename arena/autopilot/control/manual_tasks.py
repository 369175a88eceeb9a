"""Setpoints for the manual modes POSCTL, ALTCTL, STABILIZED and ACRO, from the sticks of one vehicle.

Names of parameters and the shape of the response are those of PX4 v1.16 with MPC_POS_MODE 4: in POSCTL the sticks accelerate the
vehicle against a drag, so that its speed approaches a limit; released sticks brake, then hold the position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.flight_modes import Mode
from arena.autopilot.param_table import Params
from arena.constants import GRAVITY_M_S2
from arena.geometry import quat_exp, quat_multiply
from arena.wire.sticks import Sticks

_NAN = math.nan
_STILL = 1e-7  # smaller numbers count as zero
_BOOST_FILTER_S = 0.8  # time constant of the larger drag while the vehicle brakes
_TAKEOFF_THROTTLE = 0.3  # stick position above which a vehicle on the ground takes off
_STOPPED_M_S, _STOPPED_M_S2 = 0.1, 0.2  # below both limits the vehicle holds its height
_THROTTLE_MIN_RATE, _THROTTLE_MAX_RATE = 0.05, 0.5  # rates at which the limits of the thrust change [1/s]
_MOST_TILT_DEG, _LEAST_TILT_G, _MOST_TILT_G = (
    89.0,
    0.02,
    3.0,
)  # limits of the tilt and of its acceleration in ALTCTL
_DOWN = -1.0  # sign: the throttle stick is positive up, velocities are positive down


@dataclass(frozen=True, slots=True, kw_only=True)
class ManualState:
    """State of one vehicle (estimate, height, landed ...), from which `ManualTask` computes its setpoints.

    yaw: estimated heading [rad]
    p_n, v_n: estimated position [m] and velocity [m/s] [NED]
    v_sp_n: last velocity setpoint of the position controller [m/s] [NED], NaN where there was none
    height_m: height above home [m], NaN without a home position
    flying: True if the take-off is complete
    landed: True if the land detector detects the ground
    spooled_up_s: time since the motors reached their speed, COM_SPOOLUP_TIME after arming [s]
    """

    yaw: float
    p_n: tuple[float, float, float]
    v_n: tuple[float, float, float]
    v_sp_n: tuple[float, float, float]
    height_m: float
    flying: bool
    landed: bool
    spooled_up_s: float


@dataclass(slots=True)
class ManualTask:
    """Setpoint generator of one vehicle for the manual modes.

    row: row of the vehicle in the arrays over all vehicles
    mode: mode that this task flies; None while the vehicle flies in another mode
    """

    row: int
    mode: Mode | None = None
    _yaw: float = _NAN  # heading that is held, NaN while the vehicle turns
    _yaw_rate: float = 0.0
    _v_ne: tuple[float, float] = (0.0, 0.0)
    _a_ne: tuple[float, float] = (0.0, 0.0)
    _held_ne: tuple[float, float] | None = None
    _boost: float = 1.0
    _v_d: float = 0.0
    _a_d: float = 0.0
    _held_d: float = _NAN
    _least_thrust: float = 0.0

    def enter(self, mode: Mode, s: ManualState) -> None:
        """Begin a manual mode with the previous velocity setpoint, or with the vehicle's velocity if it had none."""
        self.mode, self._yaw, self._yaw_rate = mode, _NAN, 0.0
        given = [
            sp if math.isfinite(sp) else v if math.isfinite(v) else 0.0
            for sp, v in zip(s.v_sp_n, s.v_n, strict=True)
        ]
        self._v_ne, self._a_ne, self._held_ne, self._boost = (given[0], given[1]), (0.0, 0.0), None, 1.0
        self._v_d, self._a_d, self._held_d = given[2], 0.0, _NAN

    def wants_takeoff(self, sticks: Sticks) -> bool:
        """Return whether the sticks request a take-off in POSCTL or ALTCTL."""
        return sticks.throttle > _TAKEOFF_THROTTLE

    def fly(self, sticks: Sticks, s: ManualState, sp: Setpoints, params: Params, dt: float) -> None:
        """Compute the setpoint from the stick positions, and store it in `sp`. dt: time step [s]"""
        if self.mode is Mode.ACRO:
            self._fly_rates(sticks, sp, params)
            return
        self._turn(sticks, s, params, dt)
        if self.mode in (Mode.STABILIZED, Mode.MANUAL):
            self._fly_attitude(sticks, s, sp, params, dt)
        elif not s.flying and not self.wants_takeoff(sticks):
            self._stay_down(s, sp, params)
        else:
            self._fly_velocity(sticks, s, sp, params, dt)

    def _stay_down(self, s: ManualState, sp: Setpoints, params: Params) -> None:
        """Command a descent while the vehicle is on the ground, because the land detector requires it."""
        self._v_ne, self._a_ne, self._held_ne = (0.0, 0.0), (0.0, 0.0), None
        self._v_d, self._a_d, self._held_d = 0.0, 0.0, _NAN
        sp.set_position(self.row, v_n=(0.0, 0.0, _param(params, "MPC_LAND_SPEED", self.row)), yaw=s.yaw)

    # -- heading ---------------------------------------------------------------------------------------------

    def _turn(self, sticks: Sticks, s: ManualState, params: Params, dt: float) -> None:
        """Update the yaw rate setpoint, or the heading to hold, from the yaw stick.

        A vehicle on the ground does not turn, because the arming gesture moves the yaw stick.
        """
        i = self.row
        stick = shaped(sticks.yaw, _param(params, "MPC_YAW_EXPO", i), _param(params, "MPC_HOLD_DZ", i))
        wanted = stick * math.radians(_param(params, "MPC_MAN_Y_MAX", i)) if s.flying else 0.0
        self._yaw_rate += _share(dt, _param(params, "MPC_MAN_Y_TAU", i)) * (wanted - self._yaw_rate)
        if abs(self._yaw_rate) > _STILL:
            self._yaw = _NAN
        elif math.isnan(self._yaw) or not s.flying:
            self._yaw = s.yaw

    # -- POSCTL and ALTCTL -----------------------------------------------------------------------------------

    def _fly_velocity(self, sticks: Sticks, s: ManualState, sp: Setpoints, params: Params, dt: float) -> None:
        self._move_vertically(sticks, s, params, dt)
        n, e, v_ne = _NAN, _NAN, (_NAN, _NAN)
        if self.mode is Mode.POSCTL:
            self._move_horizontally(sticks, s, params, dt)
            n, e = self._held_ne or (_NAN, _NAN)
            v_ne, a_ne = self._v_ne, self._a_ne
        else:
            a_ne = self._tilt_acceleration(sticks, s, params)
        sp.set_position(
            self.row,
            p_n=(n, e, self._held_d),
            v_n=(*v_ne, self._v_d),
            a_n=(*a_ne, self._a_d),
            yaw=self._yaw,
            yaw_rate=self._yaw_rate,
        )

    def _move_horizontally(self, sticks: Sticks, s: ManualState, params: Params, dt: float) -> None:
        """Advance the horizontal velocity setpoint by one time step, from the sticks.

        The acceleration is that of the sticks minus a drag. The drag limits the speed to MPC_VEL_MANUAL.
        """
        i, most = self.row, _param(params, "MPC_VEL_MANUAL", self.row)
        stick = self._direction(sticks, s.yaw, params)
        released = math.hypot(*stick) < _STILL
        full = 2.0 * _param(params, "MPC_ACC_HOR", i)  # with drag the mean acceleration is half of it
        wanted = max(2.0, math.sqrt(most)) if released else 1.0
        self._boost += _share(dt, _BOOST_FILTER_S) * (wanted - self._boost)
        drag = self._drag(full / most)
        crosses = any(
            math.copysign(1, a) != math.copysign(1, b) for a, b in zip(stick, self._a_ne, strict=True)
        )
        if (released or crosses) and math.hypot(*self._v_ne) < math.hypot(*drag) * dt:
            self._v_ne, drag = (0.0, 0.0), (0.0, 0.0)
        change = [full * stick[k] - drag[k] - self._a_ne[k] for k in (0, 1)]
        largest = _param(params, "MPC_JERK_MAX", i) * dt
        scale = min(1.0, largest / max(math.hypot(*change), _STILL))
        self._a_ne = (self._a_ne[0] + scale * change[0], self._a_ne[1] + scale * change[1])
        if self._v_ne == (0.0, 0.0) and released:
            self._a_ne = (0.0, 0.0)
        self._v_ne = (self._v_ne[0] + self._a_ne[0] * dt, self._v_ne[1] + self._a_ne[1] * dt)
        self._hold_position(s)

    def _direction(self, sticks: Sticks, yaw: float, params: Params) -> tuple[float, float]:
        """Return the horizontal vector (north, east) that the sticks request; full stick forward has length 1."""
        i, most = self.row, _param(params, "MPC_VEL_MANUAL", self.row)
        expo, dead = _param(params, "MPC_XY_MAN_EXPO", i), _param(params, "MPC_HOLD_DZ", i)
        ahead, right = _within_circle(shaped(sticks.pitch, expo, dead), shaped(sticks.roll, expo, dead))
        side, back = _param(params, "MPC_VEL_MAN_SIDE", i), _param(params, "MPC_VEL_MAN_BACK", i)
        right *= side / most if side >= 0.0 else 1.0
        ahead *= back / most if back >= 0.0 and ahead < 0.0 else 1.0
        return self._to_ne(ahead, right, yaw)

    def _to_ne(self, ahead: float, right: float, yaw: float) -> tuple[float, float]:
        heading = self._yaw if math.isfinite(self._yaw) else yaw
        cos, sin = math.cos(heading), math.sin(heading)
        return cos * ahead - sin * right, sin * ahead + cos * right

    def _drag(self, coefficient: float) -> tuple[float, float]:
        """Return the drag (north, east) [m/s2] that brakes the horizontal velocity setpoint.

        Below 1 m/s the drag of a braking vehicle is larger, so that the vehicle stops.
        """
        speed = math.hypot(*self._v_ne)
        braking = min(max(self._boost - 1.0, 0.0), 1.0)
        boosted = math.sqrt(speed) if speed < 1.0 else speed
        ratio = ((1.0 - braking) * speed + braking * boosted) / speed if speed > _STILL else 1.0
        factor = coefficient * self._boost * ratio
        return factor * self._v_ne[0], factor * self._v_ne[1]

    def _hold_position(self, s: ManualState) -> None:
        """Hold the present position while the velocity setpoint is zero.

        When the setpoint moves again, continue with the velocity that was commanded last.
        """
        moves = math.hypot(*self._v_ne) > _STILL
        if not moves and self._held_ne is None:
            self._held_ne = s.p_n[0], s.p_n[1]
        elif moves and self._held_ne is not None:
            self._held_ne = None
            if math.isfinite(s.v_sp_n[0]) and math.isfinite(s.v_sp_n[1]):
                self._v_ne = s.v_sp_n[0], s.v_sp_n[1]

    def _tilt_acceleration(self, sticks: Sticks, s: ManualState, params: Params) -> tuple[float, float]:
        """Convert the tilt that the sticks request in ALTCTL to an acceleration (north, east) [m/s2]."""
        tilt = math.radians(min(_param(params, "MPC_MAN_TILT_MAX", self.row), _MOST_TILT_DEG))
        most = GRAVITY_M_S2 * min(max(math.tan(tilt), _LEAST_TILT_G), _MOST_TILT_G)
        n, e = self._to_ne(*_within_circle(sticks.pitch, sticks.roll), s.yaw)
        return most * n, most * e

    def _move_vertically(self, sticks: Sticks, s: ManualState, params: Params, dt: float) -> None:
        """Advance the vertical velocity setpoint by one time step, from the throttle stick.

        Acceleration and jerk are limited. A vehicle that has stopped holds its height.
        """
        i = self.row
        stick = _DOWN * shaped(
            sticks.throttle, _param(params, "MPC_Z_MAN_EXPO", i), _param(params, "MPC_HOLD_DZ", i)
        )
        sink, climb = _vertical_limits(s.height_m, params, i)
        full = _param(params, "MPC_Z_VEL_MAX_DN" if stick > 0 else "MPC_Z_VEL_MAX_UP", i)
        wanted = min(max(stick * full, -climb), sink)
        if not s.flying:
            self._v_d, self._a_d, self._held_d = wanted, 0.0, _NAN
            return
        jerk = _param(params, "MPC_JERK_MAX", i)
        left = wanted - self._v_d
        accel = _param(params, "MPC_ACC_DOWN_MAX" if left > 0 else "MPC_ACC_UP_MAX", i)
        target = math.copysign(min(accel, math.sqrt(2.0 * jerk * abs(left))), left)
        self._a_d += min(max(target - self._a_d, -jerk * dt), jerk * dt)
        self._v_d += self._a_d * dt
        stopped = abs(self._v_d) < _STOPPED_M_S and abs(self._a_d) < _STOPPED_M_S2
        if stick != 0.0:
            self._held_d = _NAN
        elif math.isfinite(self._held_d) or stopped:
            self._held_d = self._held_d if math.isfinite(self._held_d) else s.p_n[2]
            self._v_d = self._a_d = 0.0

    # -- STABILIZED and ACRO ---------------------------------------------------------------------------------

    def _fly_attitude(self, sticks: Sticks, s: ManualState, sp: Setpoints, params: Params, dt: float) -> None:
        i = self.row
        most = math.radians(_param(params, "MPC_MAN_TILT_MAX", i))
        roll, nose_up = sticks.roll * most, -sticks.pitch * most
        tilt = math.hypot(roll, nose_up)
        scale = most / tilt if tilt > most else 1.0
        yaw = self._yaw if math.isfinite(self._yaw) else s.yaw
        turned = quat_exp((0.0, 0.0, yaw))
        tilted = quat_exp((scale * roll, scale * nose_up, 0.0))
        sp.set_position(i)
        sp.level[i], sp.q_nb[i] = Level.ATTITUDE, quat_multiply(turned, tilted)
        sp.thrust[i], sp.yaw_rate_ff[i] = self._thrust(sticks, s, params, dt), self._yaw_rate

    def _thrust(self, sticks: Sticks, s: ManualState, params: Params, dt: float) -> float:
        """Return the collective thrust 0..1 that the throttle stick requests.

        The centre of the stick is MPC_THR_HOVER, or half of the range if MPC_THR_CURVE is 1.
        """
        i = self.row
        least = 0.0 if s.landed else _param(params, "MPC_MANTHR_MIN", i)
        most_change = _THROTTLE_MIN_RATE * dt
        self._least_thrust += min(max(least - self._least_thrust, -most_change), most_change)
        hover, most = _param(params, "MPC_THR_HOVER", i), _param(params, "MPC_THR_MAX", i)
        if _param(params, "MPC_THR_CURVE", i) == 1:
            hover = 0.5 * (self._least_thrust + most)
        low, high = (self._least_thrust, hover) if sticks.throttle < 0 else (hover, most)
        part = sticks.throttle + 1.0 if sticks.throttle < 0 else sticks.throttle
        # after the spool-up, the upper limit of the thrust rises from 0 to 1 in 2 s
        return min(low + part * (high - low), max(0.0, _THROTTLE_MAX_RATE * s.spooled_up_s))

    def _fly_rates(self, sticks: Sticks, sp: Setpoints, params: Params) -> None:
        i = self.row
        level = _param(params, "MC_ACRO_EXPO", i), _param(params, "MC_ACRO_SUPEXPO", i)
        yaw = _param(params, "MC_ACRO_EXPO_Y", i), _param(params, "MC_ACRO_SUPEXPOY", i)
        sp.set_position(i)
        sp.level[i], sp.thrust[i] = Level.RATE, 0.5 * (sticks.throttle + 1.0)
        sp.omega_b[i] = (
            _super_expo(sticks.roll, *level) * math.radians(_param(params, "MC_ACRO_R_MAX", i)),
            _super_expo(-sticks.pitch, *level) * math.radians(_param(params, "MC_ACRO_P_MAX", i)),
            _super_expo(sticks.yaw, *yaw) * math.radians(_param(params, "MC_ACRO_Y_MAX", i)),
        )


def shaped(value: float, expo: float, dead_zone: float) -> float:
    """Apply the dead zone and the exponential curve to the position of one stick (-1..1).

    expo: share of the cubic curve 0..1
    dead_zone: part of the way around the centre that counts as the centre 0..1
    """
    rest = (abs(value) - dead_zone) / max(1.0 - dead_zone, 0.01)
    return math.copysign(_expo(rest, expo), value) if rest > 0.0 else 0.0


def _expo(value: float, expo: float) -> float:
    return (1.0 - expo) * value + expo * value**3


def _super_expo(value: float, expo: float, bend: float) -> float:
    return _expo(value, expo) * (1.0 - bend) / (1.0 - abs(value) * bend)


def _within_circle(x: float, y: float) -> tuple[float, float]:
    scale = 1.0 / max(1.0, math.hypot(x, y))
    return scale * x, scale * y


def _share(dt: float, tau: float) -> float:
    """Return the coefficient of a discrete first-order low-pass filter. dt: time step [s]. tau: time constant [s]"""
    return dt / (dt + tau)


def _vertical_limits(height_m: float, params: Params, i: int) -> tuple[float, float]:
    """Return the largest sink rate and climb rate [m/s].

    Near the ground they are MPC_LAND_SPEED and MPC_TKO_SPEED.
    """
    down, up = _param(params, "MPC_Z_VEL_MAX_DN", i), _param(params, "MPC_Z_VEL_MAX_UP", i)
    if math.isnan(height_m):
        return down, up
    low, high = _param(params, "MPC_LAND_ALT2", i), _param(params, "MPC_LAND_ALT1", i)
    part = min(max((height_m - low) / max(high - low, 0.01), 0.0), 1.0)
    slow, takeoff = _param(params, "MPC_LAND_SPEED", i), _param(params, "MPC_TKO_SPEED", i)
    return slow + part * (down - slow), takeoff + part * (up - takeoff)


def _param(params: Params, name: str, i: int) -> float:
    return float(params[name][i])
