"""What a program may ask for -> the MAVLink message that asks for it. Pure.

Vectors come in as (3,) or (3, 1); anything else, or a value that is not finite, is a SetpointError that tells what was found.
"""

from __future__ import annotations

import math
from enum import IntFlag
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import SetpointError
from arena.geometry import Array, quat_from_euler, quat_normalize

AttitudeKind = Literal["euler", "quaternion"]


class Ignore(IntFlag):
    """POSITION_TARGET_TYPEMASK: a bit says what the autopilot shall not look at."""

    POSITION = 0x007
    VELOCITY = 0x038
    ACCELERATION = 0x1C0
    YAW = 0x400
    YAW_RATE = 0x800


class IgnoreAttitude(IntFlag):
    """ATTITUDE_TARGET_TYPEMASK."""

    RATES = 0x07
    THRUST = 0x40
    ATTITUDE = 0x80


def vector(value: ArrayLike, what: str, size: int = 3) -> Array:
    """value: (size,) or (size, 1) -> float64 (size,). Raises SetpointError on any other shape and on nan or infinity."""
    try:
        found = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SetpointError(f"{what}: got {value!r}, expected {size} numbers") from error
    if found.shape not in ((size,), (size, 1)):
        raise SetpointError(f"{what}: got shape {found.shape}, expected ({size},) or ({size}, 1)")
    if not np.isfinite(found).all():
        raise SetpointError(f"{what}: got {found.ravel().tolist()}, expected finite numbers")
    return found.reshape(size).copy()


def scalar(value: ArrayLike, what: str) -> float:
    """value: one finite number, also as (1,) or (1, 1). Raises SetpointError on anything else."""
    try:
        found = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SetpointError(f"{what}: got {value!r}, expected a number") from error
    if found.size != 1 or not np.isfinite(found).all():
        raise SetpointError(f"{what}: got {found.tolist()}, expected one finite number")
    return float(found.reshape(()))


def period_s(freq: ArrayLike) -> float:
    """freq: how often the caller will call [Hz], above 0 -> the period [s]."""
    hz = scalar(freq, "freq")
    if not 0.0 < hz <= 1000.0:
        raise SetpointError(
            f"freq: got {hz:g} Hz, expected more than 0 and at most 1000 (PX4 leaves OFFBOARD below 2)"
        )
    return 1.0 / hz


def duration_s(time: ArrayLike) -> float:
    """time: [s], not negative."""
    seconds = scalar(time, "time")
    if seconds < 0.0:
        raise SetpointError(f"time: got {seconds:g} s, expected 0 or more")
    return seconds


def attitude(att: ArrayLike, kind: AttitudeKind) -> Array:
    """att: roll, pitch, yaw [rad] (3,) when kind is "euler"; wxyz (4,) when "quaternion" -> q_nb [-] wxyz (4,)."""
    if kind == "euler":
        return quat_from_euler(vector(att, "att"))
    if kind != "quaternion":
        raise SetpointError(f"att_type: got {kind!r}, expected 'euler' or 'quaternion'")
    q_nb = vector(att, "att", 4)
    try:
        return quat_normalize(q_nb)
    except ValueError as error:
        raise SetpointError(f"att: got {q_nb.tolist()}, which is no rotation") from error


class Encoder:
    """Messages for one vehicle. system_id: MAV_SYS_ID; each method takes the program's own time [s]."""

    def __init__(self, system_id: int) -> None:
        self._to = system_id, mavlink.MAV_COMP_ID_AUTOPILOT1

    def pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, now: float) -> mavlink.MAVLink_message:
        """pos [m] [NED] (3,); yaw [rad], 0 is north, clockwise from above."""
        mask = Ignore.VELOCITY | Ignore.ACCELERATION | Ignore.YAW_RATE
        return self._local(now, mask, pos=vector(pos, "pos"), yaw=scalar(yaw, "yaw"))

    def vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, now: float) -> mavlink.MAVLink_message:
        """vel [m/s] [NED] (3,); yaw [rad]."""
        mask = Ignore.POSITION | Ignore.ACCELERATION | Ignore.YAW_RATE
        return self._local(now, mask, vel=vector(vel, "vel"), yaw=scalar(yaw, "yaw"))

    def vel_body_yaw_rate(
        self, vel_body: ArrayLike, yaw_rate: ArrayLike, now: float
    ) -> mavlink.MAVLink_message:
        """vel_body: forward, right, down [m/s] (3,), turned by the yaw alone: level, however the body tilts; yaw_rate [rad/s]."""
        mask = Ignore.POSITION | Ignore.ACCELERATION | Ignore.YAW
        vel, rate = vector(vel_body, "vel_body"), scalar(yaw_rate, "yaw_rate")
        return self._local(now, mask, vel=vel, yaw_rate=rate, frame=mavlink.MAV_FRAME_BODY_NED)

    def att_thrust(self, q_nb: Array, thrust: float, now: float) -> mavlink.MAVLink_message:
        """q_nb [-] wxyz (4,), unit; thrust: normalised 0..1 [-]."""
        return mavlink.MAVLink_set_attitude_target_message(
            _ms(now), *self._to, int(IgnoreAttitude.RATES), q_nb.tolist(), 0.0, 0.0, 0.0, thrust
        )

    def ang_vel_thrust(self, ang_vel: ArrayLike, thrust: float, now: float) -> mavlink.MAVLink_message:
        """ang_vel: body rates [rad/s] [FRD] (3,); thrust: normalised 0..1 [-]."""
        rates = vector(ang_vel, "ang_vel").tolist()
        return mavlink.MAVLink_set_attitude_target_message(
            _ms(now), *self._to, int(IgnoreAttitude.ATTITUDE), [1.0, 0.0, 0.0, 0.0], *rates, thrust
        )

    def act(self, group: int, output: ArrayLike, now: float) -> mavlink.MAVLink_message:
        """group: 0..3; output: -1..1 [-], up to 8 of them. PX4 takes it up to v1.13 only."""
        if not isinstance(group, int) or not 0 <= group <= 3:
            raise SetpointError(f"group: got {group!r}, expected 0, 1, 2 or 3")
        found = np.asarray(output, dtype=np.float64).ravel()
        if not 1 <= found.size <= 8 or not np.isfinite(found).all() or (np.abs(found) > 1.0).any():
            raise SetpointError(f"output: got {found.tolist()}, expected 1 to 8 numbers from -1 to 1")
        controls = [*found.tolist(), *[0.0] * (8 - found.size)]
        return mavlink.MAVLink_set_actuator_control_target_message(
            _ms(now) * 1000, group, *self._to, controls
        )

    def command(self, number: int, params: tuple[float, ...], confirmation: int) -> mavlink.MAVLink_message:
        """number: MAV_CMD; params: up to 7; confirmation: 0, then 1, 2, ... when it is sent again."""
        return mavlink.MAVLink_command_long_message(
            *self._to, number, confirmation, *params, *[0.0] * (7 - len(params))
        )

    def _local(
        self,
        now: float,
        mask: Ignore,
        *,
        pos: Array | None = None,
        vel: Array | None = None,
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
        frame: int = mavlink.MAV_FRAME_LOCAL_NED,
    ) -> mavlink.MAVLink_message:
        nothing = [0.0, 0.0, 0.0]
        return mavlink.MAVLink_set_position_target_local_ned_message(
            _ms(now),
            *self._to,
            frame,
            int(mask),
            *(nothing if pos is None else pos.tolist()),
            *(nothing if vel is None else vel.tolist()),
            *nothing,
            math.remainder(yaw, math.tau),
            yaw_rate,
        )


def _ms(now: float) -> int:
    return int(now * 1e3) & 0xFFFFFFFF
