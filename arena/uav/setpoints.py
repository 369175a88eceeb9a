"""Conversion of a user program's setpoints to MAVLink messages. Pure.

Vectors have the shape (3,) or (3, 1). Any other shape, and any value that is not finite, raises SetpointError
with the value that was found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import SetpointError
from arena.geometry import Array, quat_from_euler, quat_normalize
from arena.wire.mavlink_frame import SEEDS, pack_frame

AttitudeKind = Literal["euler", "quaternion"]
_PLAIN = frozenset((float, int, np.float64))
_ZERO = (0.0, 0.0, 0.0)


class Ignore:
    """Bits of POSITION_TARGET_TYPEMASK: fields that the autopilot must ignore."""

    POSITION = 0x007
    VELOCITY = 0x038
    ACCELERATION = 0x1C0
    YAW = 0x400
    YAW_RATE = 0x800


class IgnoreAttitude:
    """Bits of ATTITUDE_TARGET_TYPEMASK: fields that the autopilot must ignore."""

    RATES = 0x07
    THRUST = 0x40
    ATTITUDE = 0x80


def vector(value: ArrayLike, what: str, size: int = 3) -> Array:
    """Check the shape of a vector and return it as a float64 array (size,).

    value: (size,) or (size, 1). Raises SetpointError for any other shape, and for NaN or infinity.
    """
    try:
        found = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SetpointError(f"{what}: got {value!r}, expected {size} numbers") from error
    if found.shape not in ((size,), (size, 1)):
        raise SetpointError(f"{what}: got shape {found.shape}, expected ({size},) or ({size}, 1)")
    if not all(map(math.isfinite, found.ravel().tolist())):  # faster than numpy for so few numbers
        raise SetpointError(f"{what}: got {found.ravel().tolist()}, expected finite numbers")
    return found.reshape(size).copy()


def numbers(value: ArrayLike, what: str, size: int = 3) -> list[float]:
    """Check a vector as `vector` does, and return its elements.

    Programs send many setpoints, most of them as lists of plain numbers, which need no array.
    """
    given: Any = value
    if isinstance(given, (list, tuple)) and len(given) == size and _PLAIN.issuperset(map(type, given)):
        plain = [float(x) for x in given]
        if all(map(math.isfinite, plain)):
            return plain
    found: list[float] = vector(value, what, size).tolist()
    return found


def scalar(value: ArrayLike, what: str) -> float:
    """Check that a value is a finite number and return it. Raises SetpointError otherwise.

    value: a number, or an array (1,) or (1, 1).
    """
    if isinstance(value, (float, int)) and math.isfinite(value):
        return float(value)
    try:
        found = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SetpointError(f"{what}: got {value!r}, expected a number") from error
    if found.size != 1 or not np.isfinite(found).all():
        raise SetpointError(f"{what}: got {found.tolist()}, expected one finite number")
    return float(found.reshape(()))


def period_s(freq: ArrayLike) -> float:
    """Return the period [s] of a rate `freq` [Hz]. Raises SetpointError outside 0 < freq <= 1000."""
    hz = scalar(freq, "freq")
    if not 0.0 < hz <= 1000.0:
        raise SetpointError(
            f"freq: got {hz:g} Hz, expected more than 0 and at most 1000 (PX4 leaves OFFBOARD below 2 Hz)"
        )
    return 1.0 / hz


def duration_s(time: ArrayLike) -> float:
    """Check a duration and return it [s]. Raises SetpointError for a negative duration."""
    seconds = scalar(time, "time")
    if seconds < 0.0:
        raise SetpointError(f"time: got {seconds:g} s, expected 0 or more")
    return seconds


def attitude(att: ArrayLike, kind: AttitudeKind) -> Array:
    """Convert an attitude to a quaternion q_nb [-] wxyz (4,).

    att: roll, pitch, yaw [rad] (3,) for the kind "euler"; wxyz (4,) for "quaternion".
    """
    if kind == "euler":
        return quat_from_euler(vector(att, "att"))
    if kind != "quaternion":
        raise SetpointError(f"att_type: got {kind!r}, expected 'euler' or 'quaternion'")
    q_nb = vector(att, "att", 4)
    try:
        return quat_normalize(q_nb)
    except ValueError as error:
        raise SetpointError(
            f"att: got {q_nb.tolist()}, expected a quaternion with a norm above zero"
        ) from error


class _Setpoint(mavlink.MAVLink_message):  # type: ignore[misc]
    """Base class of messages that are packed by a kernel, with the same bytes as pymavlink packs.

    pymavlink makes objects for the header and the CRC of each message, and keeps copies of its parts. A setpoint is packed once.
    """

    def _pack(self, mav: Any, crc_extra: int, payload: bytes, force_mavlink1: bool = False) -> bytes:
        if force_mavlink1 or mav.signing.sign_outgoing:
            data: bytes = super()._pack(mav, crc_extra, payload, force_mavlink1)
            return data
        return pack_frame(self.id, payload, mav, SEEDS[self.id])


class _LocalSetpoint(_Setpoint, mavlink.MAVLink_set_position_target_local_ned_message):  # type: ignore[misc]
    """SET_POSITION_TARGET_LOCAL_NED."""


class _AttitudeSetpoint(_Setpoint, mavlink.MAVLink_set_attitude_target_message):  # type: ignore[misc]
    """SET_ATTITUDE_TARGET."""


class Encoder:
    """Encoder of setpoints and commands as MAVLink messages to one vehicle.

    system_id: MAV_SYS_ID. now, in every method: the program's time [s].
    """

    def __init__(self, system_id: int) -> None:
        self._to = system_id, mavlink.MAV_COMP_ID_AUTOPILOT1

    def pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, now: float) -> mavlink.MAVLink_message:
        """Return a position setpoint.

        pos: [m] [NED] (3,). yaw: [rad], 0 is north, clockwise seen from above.
        """
        mask = Ignore.VELOCITY | Ignore.ACCELERATION | Ignore.YAW_RATE
        return self._local(now, mask, pos=numbers(pos, "pos"), yaw=scalar(yaw, "yaw"))

    def vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, now: float) -> mavlink.MAVLink_message:
        """Return a velocity setpoint.

        vel: [m/s] [NED] (3,).
        yaw: [rad].
        """
        mask = Ignore.POSITION | Ignore.ACCELERATION | Ignore.YAW_RATE
        return self._local(now, mask, vel=numbers(vel, "vel"), yaw=scalar(yaw, "yaw"))

    def pos_vel_yaw(
        self,
        pos: ArrayLike,
        vel: ArrayLike,
        yaw: ArrayLike,
        now: float,
        *,
        acc: ArrayLike | None = None,
        yaw_rate: ArrayLike | None = None,
    ) -> mavlink.MAVLink_message:
        """Return a trajectory setpoint: a position, and a velocity as feed-forward.

        pos: [m] [NED] (3,). vel: [m/s] [NED] (3,). yaw: [rad].
        acc: [m/s2] [NED] (3,). yaw_rate: [rad/s]. None: the autopilot must ignore the field.
        """
        mask = (Ignore.ACCELERATION if acc is None else 0) | (Ignore.YAW_RATE if yaw_rate is None else 0)
        return self._local(
            now,
            mask,
            pos=numbers(pos, "pos"),
            vel=numbers(vel, "vel"),
            acc=None if acc is None else numbers(acc, "acc"),
            yaw=scalar(yaw, "yaw"),
            yaw_rate=0.0 if yaw_rate is None else scalar(yaw_rate, "yaw_rate"),
        )

    def reference(
        self, p: ArrayLike | None, v: ArrayLike | None, yaw: ArrayLike | None, now: float
    ) -> mavlink.MAVLink_message:
        """Return the motion that the program wants to follow as POSITION_TARGET_LOCAL_NED, for the log.

        p: [m] [NED] (3,). v: [m/s] [NED] (3,). yaw: [rad]. None if the reference has no such value.
        Raises SetpointError if all three are None.
        """
        if p is None and v is None and yaw is None:
            raise SetpointError("reference: got nothing, expected at least one of p, v and yaw")
        mask = Ignore.ACCELERATION | Ignore.YAW_RATE
        mask |= Ignore.POSITION if p is None else 0
        mask |= Ignore.VELOCITY if v is None else 0
        mask |= Ignore.YAW if yaw is None else 0
        return mavlink.MAVLink_position_target_local_ned_message(
            _ms(now),
            mavlink.MAV_FRAME_LOCAL_NED,
            mask,
            *(_ZERO if p is None else numbers(p, "p")),
            *(_ZERO if v is None else numbers(v, "v")),
            *_ZERO,
            0.0 if yaw is None else math.remainder(scalar(yaw, "yaw"), math.tau),
            0.0,
        )

    def vel_body_yaw_rate(
        self, vel_body: ArrayLike, yaw_rate: ArrayLike, now: float
    ) -> mavlink.MAVLink_message:
        """Return a velocity setpoint in level vehicle axes: they turn with the yaw, but do not tilt.

        vel_body: forward, right, down [m/s] (3,).
        yaw_rate: [rad/s].
        """
        mask = Ignore.POSITION | Ignore.ACCELERATION | Ignore.YAW
        vel, rate = numbers(vel_body, "vel_body"), scalar(yaw_rate, "yaw_rate")
        return self._local(now, mask, vel=vel, yaw_rate=rate, frame=mavlink.MAV_FRAME_BODY_NED)

    def att_thrust(self, q_nb: Array, thrust: float, now: float) -> mavlink.MAVLink_message:
        """Return an attitude setpoint.

        q_nb: [-] wxyz (4,), unit.
        thrust: normalised 0..1 [-].
        """
        return _AttitudeSetpoint(
            _ms(now), *self._to, IgnoreAttitude.RATES, q_nb.tolist(), 0.0, 0.0, 0.0, thrust
        )

    def ang_vel_thrust(self, ang_vel: ArrayLike, thrust: float, now: float) -> mavlink.MAVLink_message:
        """Return a setpoint of body rates and thrust.

        ang_vel: body rates [rad/s] [FRD] (3,).
        thrust: normalised 0..1 [-].
        """
        rates = numbers(ang_vel, "ang_vel")
        return _AttitudeSetpoint(
            _ms(now), *self._to, IgnoreAttitude.ATTITUDE, [1.0, 0.0, 0.0, 0.0], *rates, thrust
        )

    def act(self, group: int, output: ArrayLike, now: float) -> mavlink.MAVLink_message:
        """Return an actuator setpoint, for PX4 up to v1.13.

        group: 0..3.
        output: up to 8 numbers -1..1 [-].
        """
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
        """Return a COMMAND_LONG message to the vehicle.

        number: MAV_CMD.
        params: up to 7.
        confirmation: 0 when the command is first sent, then 1, 2, ... for repetitions.
        """
        return mavlink.MAVLink_command_long_message(
            *self._to, number, confirmation, *params, *[0.0] * (7 - len(params))
        )

    def command_at(
        self, number: int, params: tuple[float, ...], confirmation: int
    ) -> mavlink.MAVLink_message:
        """Return a COMMAND_INT message. Its position has a resolution of 1e-7 deg (1 cm).

        number: MAV_CMD. params: 7, of which param5 and param6 are latitude and longitude [deg], and param7 the altitude [m].
        confirmation: not contained in COMMAND_INT.
        """
        x, y = (round(angle * 1e7) for angle in params[4:6])
        return mavlink.MAVLink_command_int_message(
            *self._to, mavlink.MAV_FRAME_GLOBAL, number, 0, 0, *params[:4], x, y, params[6]
        )

    def _local(
        self,
        now: float,
        mask: int,
        *,
        pos: Sequence[float] = _ZERO,
        vel: Sequence[float] = _ZERO,
        acc: Sequence[float] | None = None,
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
        frame: int = mavlink.MAV_FRAME_LOCAL_NED,
    ) -> mavlink.MAVLink_message:
        return _LocalSetpoint(
            _ms(now),
            *self._to,
            frame,
            mask,
            *pos,
            *vel,
            *(_ZERO if acc is None else acc),
            math.remainder(yaw, math.tau),
            yaw_rate,
        )


def _ms(now: float) -> int:
    return int(now * 1e3) & 0xFFFFFFFF
