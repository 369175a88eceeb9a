"""Setpoints for OFFBOARD mode: checks position setpoints with PX4's rules, and keeps the newest setpoint of each vehicle.

Pure. NaN means that a value is not given.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import rotations
from arena.kernels.arrays import floats, new_integers

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats, Integers

_NONE, _RATE, _ATTITUDE, _POSITION = 0, 1, 2, 3  # levels of a setpoint, as in `cascade`
_HAS_VELOCITY, _HAS_ACCELERATION, _HAS_ATTITUDE, _HAS_RATES = 2, 4, 8, 16  # `contents`
_LOCAL_NED, _BODY_NED = 1, 8  # MAV_FRAME
_FORCE, _YAW_IGNORED, _YAW_RATE_IGNORED = 1 << 9, 1 << 10, 1 << 11  # POSITION_TARGET_TYPEMASK
_V, _A, _YAW, _YAW_RATE, _VALUES = 3, 6, 9, 10, 11  # elements of `target`
_MAX_ABS = 1e6  # [m], [m/s], [m/s2], [rad], [rad/s]: a larger value is a mistake
_NEVER = -1e9
_NAN = float("nan")


class OffboardSetpoints:
    """Newest offboard setpoint of each of V vehicles.

    q_nb: input: estimated attitudes [-] wxyz (V, 4)
    target: input: position [m], velocity [m/s], acceleration [m/s2], yaw [rad] and yaw rate [rad/s] of a received message (11,)
    level: controller that receives the setpoint: POSITION 3, ATTITUDE 2, RATE 1, 0 before the first setpoint (V,)
    p_n, v_n, a_n: position [m], velocity [m/s], acceleration [m/s2] [NED] (V, 3)
    yaw, yaw_rate: heading [rad] and its rate [rad/s] (V,)
    attitude: attitude setpoint [-] wxyz (V, 4)
    omega_b: body rates [rad/s] [FRD] (V, 3)
    thrust: collective thrust 0..1 (V,)
    contents: sum of what the setpoint contains: position 1, velocity 2, acceleration 4, attitude 8, body rates 16 (V,)
    received_at: time of arrival [s] (V,)
    """

    def __init__(self, q_nb: Floats) -> None:
        v, self.q_nb, self.target = len(q_nb), q_nb, floats(_VALUES)
        self.level, self.contents, self.received_at = new_integers(v), new_integers(v), floats(v, fill=_NEVER)
        self.p_n, self.v_n, self.a_n = floats(v, 3), floats(v, 3), floats(v, 3)
        self.yaw, self.yaw_rate, self.thrust = floats(v), floats(v), floats(v)
        self.attitude, self.omega_b = floats(v, 4), floats(v, 3)

    def write_setpoints_to(
        self,
        level: Integers,
        p_n: Floats,
        v_n: Floats,
        a_n: Floats,
        yaw: Floats,
        yaw_rate: Floats,
        q_nb: Floats,
        omega_b: Floats,
        thrust: Floats,
        yaw_rate_ff: Floats,
    ) -> None:
        """Store the controllers' arrays, to which `copy` writes. See `arena.autopilot.control.setpoints.Setpoints`."""
        self._to_level, self._to_p_n, self._to_v_n, self._to_a_n = level, p_n, v_n, a_n
        self._to_yaw, self._to_yaw_rate, self._to_q_nb, self._to_omega_b = yaw, yaw_rate, q_nb, omega_b
        self._to_thrust, self._to_yaw_rate_ff = thrust, yaw_rate_ff

    # -- arrival ---------------------------------------------------------------------------------------------

    def set_local_target(self, i: int, mask: int, frame: int, now: float) -> str | None:
        """Store `target` of a SET_POSITION_TARGET_LOCAL_NED as the setpoint of vehicle i.

        In body frames a velocity is rotated by the heading alone, an acceleration by the whole attitude, and a position is
        ignored. If one axis of a body-frame vector is ignored, all three are.

        mask: POSITION_TARGET_TYPEMASK
        frame: MAV_FRAME
        now: time of arrival [s]

        Return None, or the reason if the setpoint is refused.
        """
        if frame == _BODY_NED:
            self._ignore(0, 7)
            self._ignore(_V, 7 if mask >> _V & 7 else 0)
            self._ignore(_A, 7 if mask >> _A & 7 else 0)
            q = (self.q_nb[i, 0], self.q_nb[i, 1], self.q_nb[i, 2], self.q_nb[i, 3])
            self._turn(_V, rotations.yaw(q))
            self._rotate(_A, q)
        elif frame == _LOCAL_NED:
            self._ignore_axes(mask)
        else:
            return f"coordinate frame {frame} is not supported"
        return self._set_position(i, mask, now)

    def set_global_target(self, i: int, mask: int, heading: float, now: float) -> str | None:
        """Store `target` of a SET_POSITION_TARGET_GLOBAL_INT as the setpoint of vehicle i.

        The position is already a local one. Velocity, acceleration and yaw count from true north.

        mask: POSITION_TARGET_TYPEMASK
        heading: direction of the local frame's north, clockwise from true north [rad]
        now: time of arrival [s]

        Return None, or the reason if the setpoint is refused.
        """
        self._ignore_axes(mask)
        if heading != 0.0:
            self._turn(_V, -heading)
            self._turn(_A, -heading)
            self.target[_YAW] -= heading
        return self._set_position(i, mask, now)

    def set_attitude(
        self, i: int, q_nb: rotations.Quaternion, yaw_rate: float, thrust: float, now: float
    ) -> None:
        """Store an attitude setpoint of vehicle i. q_nb: unit quaternion wxyz. now: time of arrival [s]"""
        self._begin(i, _ATTITUDE, _HAS_ATTITUDE, now)
        self.attitude[i, 0], self.attitude[i, 1], self.attitude[i, 2], self.attitude[i, 3] = q_nb
        self.yaw_rate[i], self.thrust[i] = yaw_rate, thrust

    def set_rates(self, i: int, omega_b: rotations.Vector, thrust: float, now: float) -> None:
        """Store a setpoint of the body rates of vehicle i. now: time of arrival [s]"""
        self._begin(i, _RATE, _HAS_RATES, now)
        self.omega_b[i, 0], self.omega_b[i, 1], self.omega_b[i, 2] = omega_b
        self.thrust[i] = thrust

    def _begin(self, i: int, level: int, contents: int, now: float) -> None:
        """Start a new setpoint of vehicle i, in which no value is given."""
        self.level[i], self.contents[i], self.received_at[i] = level, contents, now
        for k in range(3):
            self.p_n[i, k] = self.v_n[i, k] = self.a_n[i, k] = _NAN
            self.attitude[i, k + 1] = self.omega_b[i, k] = 0.0
        self.yaw[i] = self.yaw_rate[i] = _NAN
        self.attitude[i, 0], self.thrust[i] = 1.0, 0.0

    # -- position setpoints ----------------------------------------------------------------------------------

    def _ignore_axes(self, mask: int) -> None:
        self._ignore(0, mask & 7)
        self._ignore(_V, mask >> _V & 7)
        self._ignore(_A, mask >> _A & 7)

    def _ignore(self, first: int, axes: int) -> None:
        """Remove axes of a vector of `target`. first: element of its first axis. axes: bits of the axes"""
        for k in range(3):
            if axes >> k & 1:
                self.target[first + k] = _NAN

    def _turn(self, first: int, angle: float) -> None:
        """Rotate a vector of `target` about the down axis by an angle [rad].

        NaN in one horizontal axis makes both NaN.
        """
        x, y = self.target[first], self.target[first + 1]
        if math.isnan(x) or math.isnan(y):
            self.target[first] = self.target[first + 1] = _NAN
            return
        c, s = math.cos(angle), math.sin(angle)
        self.target[first], self.target[first + 1] = c * x - s * y, s * x + c * y

    def _rotate(self, first: int, q: rotations.Quaternion) -> None:
        """Rotate a vector of `target` by a quaternion. NaN in one axis makes all NaN.

        The terms are added in another order than by `rotations.rotated`, as they were in earlier flights.
        """
        a, b, c = self.target[first], self.target[first + 1], self.target[first + 2]
        w, x, y, z = q
        tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        self.target[first] = a + w * tx + y * tz - z * ty
        self.target[first + 1] = b + w * ty + z * tx - x * tz
        self.target[first + 2] = c + w * tz + x * ty - y * tx
        if math.isnan(a) or math.isnan(b) or math.isnan(c):
            self._ignore(first, 7)

    def _set_position(self, i: int, mask: int, now: float) -> str | None:
        """Check `target` and store it as the setpoint of vehicle i. Return the reason if it is refused."""
        target = self.target
        if mask & _YAW_IGNORED:
            target[_YAW] = _NAN
        if mask & _YAW_RATE_IGNORED:
            target[_YAW_RATE] = _NAN
        contents = self._contents_of_target()
        refusal = self._refusal(mask, contents)
        if refusal is not None:
            return refusal
        if not self._is_complete():
            # PX4 stops and holds if an axis has no setpoint, or one horizontal axis has one and the other has
            # not.
            self._begin(i, _POSITION, _HAS_VELOCITY, now)
            self.v_n[i, 0] = self.v_n[i, 1] = self.v_n[i, 2] = 0.0
            return None
        self._begin(i, _POSITION, contents, now)
        for k in range(3):
            self.p_n[i, k], self.v_n[i, k], self.a_n[i, k] = target[k], target[_V + k], target[_A + k]
        self.yaw[i], self.yaw_rate[i] = target[_YAW], target[_YAW_RATE]
        return None

    def _contents_of_target(self) -> int:
        """Return which vectors `target` contains, as in `contents`."""
        found = 0
        for k in range(_YAW):
            if math.isfinite(self.target[k]):
                found |= 1 << k // 3
        return found

    def _refusal(self, mask: int, contents: int) -> str | None:
        """Return why `target` is refused, None if it is not. contents: what it contains"""
        for k in range(_VALUES):
            if abs(self.target[k]) > _MAX_ABS:  # PX4 refuses infinite values only
                return "infinite value in setpoint"
        if mask & _FORCE and contents & _HAS_ACCELERATION:
            return "force setpoints are not supported"
        return "setpoint without position, velocity or acceleration" if contents == 0 else None

    def _is_complete(self) -> bool:
        """Return whether each axis of `target` has a value, and both horizontal axes have the same kinds of values."""
        target, given = self.target, 0
        for k in range(_YAW):
            if math.isfinite(target[k]):
                given |= 1 << k
        every_axis = (given | given >> _V | given >> _A) & 7 == 7
        return every_axis and (given ^ given >> 1) & 0b001001001 == 0

    # -- control ---------------------------------------------------------------------------------------------

    def copy(self, i: int) -> None:
        """Write the setpoint of vehicle i to the controllers' arrays. Do nothing before the first setpoint."""
        level = self.level[i]
        if level == _NONE:
            return
        self._to_level[i] = level
        for k in range(3):
            self._to_p_n[i, k], self._to_v_n[i, k] = self.p_n[i, k], self.v_n[i, k]
            self._to_a_n[i, k], self._to_omega_b[i, k] = self.a_n[i, k], self.omega_b[i, k]
        for k in range(4):
            self._to_q_nb[i, k] = self.attitude[i, k]
        self._to_yaw[i], self._to_yaw_rate[i], self._to_thrust[i] = (
            self.yaw[i],
            self.yaw_rate[i],
            self.thrust[i],
        )
        self._to_yaw_rate_ff[i] = self.yaw_rate[i] if level == _ATTITUDE else 0.0
