"""MAVLink telemetry computed from a vehicle's log, for flights without a record flight.mcap. Pure.

Each row gives one datagram, at the time of the row. It contains a message for each group of columns that the row has. Mode, armed,
landed and battery are repeated once a second, and sent when they change.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.flight_log.columns import RPY, WXYZ
from arena.flight_log.flight import Flight
from arena.geometry import Array, quat_from_euler
from arena.vehicle_models import DEFAULT_CLASS, VEHICLE_MODELS
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT
from arena.wire.px4_mode import mode_numbers

_STATE_PERIOD_S = 1.0
_MAX_BOOT_MS = 1 << 31
_GAUSS_PER_T, _HPA_PER_PA = 1e4, 1e-2
_MAG_FIELDS, _BARO_FIELDS, _IMU_FIELDS = 0x01C0, 0x1A00, 0x003F
_PWM_RANGE = 1000.0
_ARMED_BIT, _CUSTOM_BIT = mavlink.MAV_MODE_FLAG_SAFETY_ARMED, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_NO_ACCELERATION = 0b0001_1100_0000  # type_mask of POSITION_TARGET_LOCAL_NED
_NO_YAW_RATE, _NO_YAW = 1 << 11, 1 << 10
_NO_RATES, _NO_THRUST, _NO_ATTITUDE = 0b0000_0111, 1 << 6, 1 << 7  # type_mask of ATTITUDE_TARGET
MAVSDK_MODES = {
    "HOLD": "AUTO.LOITER",
    "LAND": "AUTO.LAND",
    "TAKEOFF": "AUTO.TAKEOFF",
    "RETURN_TO_LAUNCH": "AUTO.RTL",
    "MISSION": "AUTO.MISSION",
}
"""Name of a flight mode in MAVSDK -> PX4's name."""


def custom_mode(words: str) -> int:
    """Return the MAVLink custom_mode of a flight mode such as `AUTO.LAND`, or 0 for an unknown name."""
    try:
        main, sub = mode_numbers(MAVSDK_MODES.get(words, words))
    except KeyError:
        return 0
    return main << 16 | sub << 24


class SyntheticTelemetry:
    """Telemetry of one vehicle, computed from the rows of its log.

    flight: the log.
    system: MAVLink system id of the vehicle.
    """

    def __init__(self, flight: Flight, system: int) -> None:
        self._flight, self._codec = flight, Codec(system, AUTOPILOT)
        self._group = {
            "pos": flight.group("ekf.pos"),
            "vel": flight.group("ekf.vel"),
            "q": flight.group("ekf.att_q", WXYZ),
            "rates": flight.group("ekf.ang_vel", RPY),
            "acc": flight.group("imu.acc_body"),
            "gyro": flight.group("imu.ang_vel", RPY),
            "mag": flight.group("imu.mag"),
            "pos_ref": flight.group("pos_ref"),
            "vel_ref": flight.group("vel_ref"),
            "q_ref": _attitude_reference(flight),
            "rates_ref": flight.group("ang_vel_ref", RPY),
            "baro": flight.group("baro", ("pressure", "temperature", "alt")),
            "output": flight.group("act.output", tuple(str(k + 1) for k in range(8))),
        }
        rotors = _rotors(self._group["output"], flight.armed)
        self._mav_type = VEHICLE_MODELS[DEFAULT_CLASS].mav_type(rotors)
        self._yaw_ref = _column(flight, "pos_ref.yaw")
        self._thrust_ref = _column(flight, "thrust_ref")
        self._battery, self._voltage = _column(flight, "info.battery"), _column(flight, "bat.voltage")
        self._boot_s = flight.t + (flight.t0 if 1e3 * (flight.t0 + _last(flight.t)) < _MAX_BOOT_MS else 0.0)

    def datagrams(self) -> Iterator[tuple[float, bytes]]:
        """Yield (time by the clock of the log [s], datagram) for each row of the log."""
        flight, state_due, state = self._flight, -math.inf, None
        for i, t in enumerate((flight.t0 + flight.t).tolist()):
            now = (flight.mode[i], bool(flight.armed[i]), bool(flight.landed[i]))
            parts: list[mavlink.MAVLink_message] = []
            if now != state or t >= state_due:
                state, state_due = now, t + _STATE_PERIOD_S
                parts += self._state(i)
            parts += [*self._estimate(i), *self._sensors(i), *self._references(i), *self._outputs(i)]
            if parts:
                yield t, b"".join(map(self._codec.pack, parts))

    def _boot_ms(self, i: int) -> int:
        return max(0, round(1e3 * float(self._boot_s[i])))

    def _state(self, i: int) -> Iterator[mavlink.MAVLink_message]:
        flight = self._flight
        base = _CUSTOM_BIT | (_ARMED_BIT if flight.armed[i] else 0)
        status = mavlink.MAV_STATE_ACTIVE if flight.armed[i] else mavlink.MAV_STATE_STANDBY
        yield mavlink.MAVLink_heartbeat_message(
            self._mav_type,
            mavlink.MAV_AUTOPILOT_PX4,
            base,
            custom_mode(flight.mode[i]),
            status,
            3,
        )
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND if flight.landed[i] else mavlink.MAV_LANDED_STATE_IN_AIR
        yield mavlink.MAVLink_extended_sys_state_message(0, landed)
        charge, voltage = self._battery[i], self._voltage[i]
        yield mavlink.MAVLink_sys_status_message(
            *(0, 0, 0, 0),
            round(1e3 * float(voltage)) if np.isfinite(voltage) else 0xFFFF,
            -1,
            round(float(np.clip(charge, 0.0, 100.0))) if np.isfinite(charge) else -1,
            *(0,) * 6,
        )

    def _estimate(self, i: int) -> Iterator[mavlink.MAVLink_message]:
        pos, vel, q, rates = (self._group[name][i] for name in ("pos", "vel", "q", "rates"))
        if _finite(pos):
            yield mavlink.MAVLink_local_position_ned_message(self._boot_ms(i), *pos, *np.nan_to_num(vel))
        if _finite(q):
            yield mavlink.MAVLink_attitude_quaternion_message(self._boot_ms(i), *q, *np.nan_to_num(rates))

    def _sensors(self, i: int) -> Iterator[mavlink.MAVLink_message]:
        acc, gyro, mag, baro = (self._group[name][i] for name in ("acc", "gyro", "mag", "baro"))
        if not _finite(acc):
            return
        fields = _IMU_FIELDS | (_MAG_FIELDS if _finite(mag) else 0) | (_BARO_FIELDS if _finite(baro) else 0)
        pressure, temperature, altitude = np.nan_to_num(baro)
        yield mavlink.MAVLink_highres_imu_message(
            round(1e6 * float(self._boot_s[i])),
            *acc,
            *np.nan_to_num(gyro),
            *np.nan_to_num(mag) * _GAUSS_PER_T,
            pressure * _HPA_PER_PA,
            0.0,
            altitude,
            temperature,
            fields,
        )

    def _references(self, i: int) -> Iterator[mavlink.MAVLink_message]:
        pos, vel, yaw = self._group["pos_ref"][i], self._group["vel_ref"][i], self._yaw_ref[i]
        if np.isfinite(pos).any() or np.isfinite(vel).any():
            ignored = [not x for x in (*np.isfinite(pos), *np.isfinite(vel))]
            mask = sum(1 << bit for bit, off in enumerate(ignored) if off) | _NO_ACCELERATION | _NO_YAW_RATE
            mask |= 0 if np.isfinite(yaw) else _NO_YAW
            values = np.nan_to_num((*pos, *vel, 0.0, 0.0, 0.0, yaw, 0.0))
            yield mavlink.MAVLink_position_target_local_ned_message(
                self._boot_ms(i), mavlink.MAV_FRAME_LOCAL_NED, mask, *values
            )
        q, rates, thrust = self._group["q_ref"][i], self._group["rates_ref"][i], self._thrust_ref[i]
        if _finite(q):
            mask = 0 if _finite(rates) else _NO_RATES
            mask |= 0 if np.isfinite(thrust) else _NO_THRUST
            yield mavlink.MAVLink_attitude_target_message(self._boot_ms(i), mask, q.tolist(), *rates, thrust)

    def _outputs(self, i: int) -> Iterator[mavlink.MAVLink_message]:
        output = self._group["output"][i]
        if np.isfinite(output).any():
            pwm = [
                round(_PWM_RANGE + _PWM_RANGE * x) for x in np.clip(np.nan_to_num(output), 0.0, 1.0).tolist()
            ]
            time_us = round(1e6 * float(self._boot_s[i])) & 0xFFFFFFFF
            yield mavlink.MAVLink_servo_output_raw_message(time_us, 0, *pwm)


def _rotors(output: Array, armed: NDArray[np.bool_]) -> int:
    """Return the number of rotors of a vehicle, from its motor outputs.

    The output of a rotor is above 0 while the vehicle is armed, and 0 in most rows while it is disarmed. The output of a servo or
    gimbal is above 0 all the time, so it is not counted.

    output: all outputs (n, 8) [-], NaN for unknown ones.  armed: (n,).
    """
    above = output > 0.0
    idle = above[~armed].mean(axis=0) < 0.5 if not armed.all() else np.ones(above.shape[1], bool)
    return int(np.count_nonzero(above[armed].any(axis=0) & idle))


def _attitude_reference(flight: Flight) -> Array:
    """Return the attitude setpoint of each log row [-] wxyz (n, 4).

    It is computed from the logged quaternion, or from the Euler angles if there is no quaternion.
    """
    q = flight.group("att_q_ref", WXYZ)
    if np.isfinite(q).all(axis=1).any():
        return q
    euler = flight.group("att_euler_ref", RPY)
    known = np.isfinite(euler).all(axis=1)
    q[known] = np.array([quat_from_euler(row) for row in euler[known]]).reshape(-1, 4)
    return q


def _column(flight: Flight, name: str) -> Array:
    found = flight.numbers.get(name)
    return np.full(flight.t.size, np.nan) if found is None else found


def _finite(values: Array) -> bool:
    return bool(np.isfinite(values).all())


def _last(t: Array) -> float:
    return float(t[-1]) if t.size else 0.0
