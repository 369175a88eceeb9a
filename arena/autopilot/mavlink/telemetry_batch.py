"""Encoding of the frequent telemetry messages for many vehicles at once, in a few numpy calls.

Each `_fill` function writes the fields of one message for the given vehicles. `arena.wire.mavlink_records`
defines the names and the layout of the fields.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.atmosphere import pressure_hpa
from arena.autopilot.commander import Mode
from arena.autopilot.mavlink.telemetry_state import TelemetryState
from arena.autopilot.vehicle import Vehicle
from arena.constants import INT32_MAX, INT32_MIN
from arena.geometry import globe_from_local, turn_horizontal
from arena.wire import mavlink_records
from arena.wire.mavlink_records import Records

Array = NDArray[np.float64]

_NAN = math.nan
INT32 = (float(INT32_MIN), float(INT32_MAX))
INT16 = (-32768.0, 32767.0)
_DIAGONAL = np.array((0, 6, 11, 15, 18, 20))  # of the row-major upper triangle


@dataclass(slots=True)
class Rows:
    """The vehicles that send a certain message in this step, with the index of each vehicle in the state arrays.

    i: row numbers of the vehicles in the arrays over all vehicles
    s: state of all vehicles
    """

    vehicles: list[Vehicle]
    i: NDArray[np.intp]
    s: TelemetryState


@dataclass(frozen=True, slots=True)
class BatchedMessage:
    """Describes how one message is encoded for many vehicles at once.

    template: record with the constant fields filled in
    fill: function that writes the other fields
    available: function that returns whether a vehicle has valid content; None if it always has
    """

    template: Records
    fill: Callable[[Records, Rows], None]
    available: Callable[[Vehicle, TelemetryState], bool] | None = None


def payloads(requested: Iterable[tuple[Vehicle, int]], s: TelemetryState) -> dict[int, dict[int, bytes]]:
    """Encode the requested messages. Return their payloads: message id -> index of the vehicle -> payload.

    A vehicle without valid content has no payload. Message ids that this module does not support are ignored.

    requested: (vehicle, message id), in any order; an entry may occur more than once
    """
    senders: defaultdict[int, dict[int, Vehicle]] = defaultdict(dict)
    for v, msgid in requested:
        senders[msgid][v.row] = v
    return {msgid: _encode(BATCHED[msgid], rows, s) for msgid, rows in senders.items() if msgid in BATCHED}


def _encode(message: BatchedMessage, vehicles: dict[int, Vehicle], s: TelemetryState) -> dict[int, bytes]:
    if message.available is not None:
        vehicles = {row: v for row, v in vehicles.items() if message.available(v, s)}
        if not vehicles:
            return {}
    records = message.template.repeat(len(vehicles))
    message.fill(records, Rows(list(vehicles.values()), np.array(list(vehicles), np.intp), s))
    return dict(zip(vehicles, mavlink_records.payloads(records), strict=True))


def global_position(origins: Array, p_n: Array) -> tuple[Array, Array, Array]:
    """Return latitude, longitude [1e-7 deg] and altitude [mm] of local positions, clamped to int32.

    origins: latitude, longitude [deg], altitude AMSL [m], heading [rad] of the local frames (n, 4)
    p_n: positions [m] [NED] (n, 3)
    """
    lat0, lon0, alt0, heading = origins.T
    lat, lon = globe_from_local(lat0, lon0, p_n[:, 0], p_n[:, 1], heading)
    lat = np.minimum(np.maximum(lat, -90.0), 90.0)
    return (
        np.rint(lat * 1e7),
        np.rint(((lon + 180.0) % 360.0 - 180.0) * 1e7),
        _clamped((alt0 - p_n[:, 2]) * 1e3, INT32),
    )


def _clamped(values: Array, limits: tuple[float, float]) -> Array:
    return np.asarray(np.minimum(np.maximum(values, limits[0]), limits[1]))


def _heartbeat(out: Records, rows: Rows) -> None:
    out["type"] = [v.mav_type for v in rows.vehicles]
    out["custom_mode"] = [v.commander.mode.custom_mode for v in rows.vehicles]
    out["base_mode"] = [_base_mode(v) for v in rows.vehicles]
    out["status"] = [_status(v) for v in rows.vehicles]


def _base_mode(v: Vehicle) -> int:
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
        mavlink.MAV_MODE_FLAG_SAFETY_ARMED if v.commander.armed else 0
    )
    base |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    if v.commander.mode is not Mode.OFFBOARD:
        base |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    return int(base)


def _status(v: Vehicle) -> int:
    c = v.commander
    if c.mode is Mode.TERMINATE:
        return int(mavlink.MAV_STATE_FLIGHT_TERMINATION)
    return int(
        mavlink.MAV_STATE_CRITICAL
        if c.failsafe
        else mavlink.MAV_STATE_ACTIVE
        if c.armed
        else mavlink.MAV_STATE_STANDBY
    )


def _attitude(out: Records, rows: Rows) -> None:
    out["time_boot_ms"] = rows.s.ms
    out["rpy"], out["omega_b"] = rows.s.rpy[rows.i], rows.s.est.omega_b[rows.i]


def _attitude_quaternion(out: Records, rows: Rows) -> None:
    out["time_boot_ms"] = rows.s.ms
    out["q_nb"], out["omega_b"] = rows.s.est.q_nb[rows.i], rows.s.est.omega_b[rows.i]


def _local_position(out: Records, rows: Rows) -> None:
    out["time_boot_ms"] = rows.s.ms
    out["p_n"], out["v_n"] = rows.s.p_n[rows.i], rows.s.v_n[rows.i]


def _odometry(out: Records, rows: Rows) -> None:
    i, s = rows.i, rows.s
    variance = s.variance[i]
    out["time_usec"] = s.us
    out["p_n"], out["q_nb"], out["v_n"], out["omega_b"] = s.p_n[i], s.est.q_nb[i], s.v_n[i], s.est.omega_b[i]
    out["pose_variance"][:, _DIAGONAL] = variance[:, 0:6]
    out["velocity_variance"][:, _DIAGONAL[:3]] = variance[:, 6:9]
    out["reset_counter"] = s.est.reset_counter[i] & 0xFF


def _highres_imu(out: Records, rows: Rows) -> None:
    i, s = rows.i, rows.s
    height = s.baro_alt_m[i]
    out["time_usec"] = s.us
    out["accel_b"], out["gyro_b"], out["mag_b"] = s.accel_b[i], s.gyro_b[i], s.mag_b[i]
    out["pressure"], out["altitude"] = pressure_hpa(height), height


def _global_position(out: Records, rows: Rows) -> None:
    i, s = rows.i, rows.s
    p_n, v_n = s.p_n[i], s.v_n[i].copy()
    origins = np.array([v.origin for v in rows.vehicles])
    v_n[:, 0], v_n[:, 1] = turn_horizontal(v_n[:, 0], v_n[:, 1], origins[:, 3])
    home_d = np.array([v.home_n[2] if v.home_n else 0.0 for v in rows.vehicles])
    out["time_boot_ms"] = s.ms
    out["lat"], out["lon"], out["alt"] = global_position(origins, p_n)
    out["relative_alt"] = _clamped((home_d - p_n[:, 2]) * 1e3, INT32)
    out["v_n"] = _clamped(v_n * 100.0, INT16)
    out["heading"] = np.degrees(s.rpy[i, 2] + origins[:, 3]) % 360.0 * 100.0 % 36000.0


def _altitude(out: Records, rows: Rows) -> None:
    up = -rows.s.p_n[rows.i, 2]
    heights = out["heights"]
    out["time_usec"] = rows.s.us
    heights[:, 0], heights[:, 2] = rows.s.baro_alt_m[rows.i], up
    heights[:, 1] = up + [v.origin.alt if v.origin else _NAN for v in rows.vehicles]
    heights[:, 3] = up + [v.home_n[2] if v.home_n else _NAN for v in rows.vehicles]


def _attitude_target(out: Records, rows: Rows) -> None:
    i, s = rows.i, rows.s
    out["time_boot_ms"] = s.ms
    out["q_nb"], out["omega_b"], out["thrust"] = s.cascade.q_sp[i], s.cascade.omega_sp[i], s.thrust[i]


_IGNORE = np.array(
    [1 << k for k in (*range(9), 10, 11)]
)  # POSITION_TARGET_TYPEMASK of p, v, a, yaw, yaw rate


def _position_target(out: Records, rows: Rows) -> None:
    values = rows.s.setpoint[rows.i]
    out["time_boot_ms"] = rows.s.ms
    out["values"], out["mask"] = values, ~np.isfinite(values) @ _IGNORE


def _servo_output_raw(out: Records, rows: Rows) -> None:
    motors = rows.s.motors[rows.i, :8]
    armed = np.array([[v.commander.armed] for v in rows.vehicles])
    out["time_usec"] = rows.s.us & 0xFFFFFFFF
    out["servos"][:, : motors.shape[1]] = np.where(armed, 1000.0 + 1000.0 * motors, 900.0)


def _timesync(out: Records, rows: Rows) -> None:
    out["ts1"] = int(rows.s.now_s * 1e9)


def _vfr_hud(out: Records, rows: Rows) -> None:
    i, s = rows.i, rows.s
    v = s.v_n[i]
    out["airspeed"] = out["groundspeed"] = np.hypot(v[:, 0], v[:, 1])
    out["alt"] = [v.origin.alt if v.origin else 0.0 for v in rows.vehicles] - s.p_n[i, 2]
    out["climb"] = -v[:, 2]
    heading = [v.heading for v in rows.vehicles]
    out["heading"], out["throttle"] = np.degrees(s.rpy[i, 2] + heading) % 360.0, 100.0 * s.thrust[i]


def _extended_sys_state(out: Records, rows: Rows) -> None:
    out["landed"] = [v.landed_state for v in rows.vehicles]


_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
    | mavlink.MAV_SYS_STATUS_AHRS
)


def _sys_status(out: Records, rows: Rows) -> None:
    i, s = rows.i, rows.s
    out["present"] = out["enabled"] = [_present(v, s) for v in rows.vehicles]
    out["health"] = [_health(v, s) for v in rows.vehicles]
    out["voltage"] = _clamped(s.battery_v[i] * 1e3, (0.0, 65534.0))
    out["current"] = _clamped(s.battery_a[i] * 100.0, INT16)
    out["remaining"] = np.rint(100.0 * s.battery[i])


def _present(v: Vehicle, s: TelemetryState) -> int:
    # SDKs interpret the GPS bit as "the global position is valid", whatever its source.
    present = _SENSORS | (
        mavlink.MAV_SYS_STATUS_SENSOR_GPS if v.origin is not None and s.xy_valid[v.row] else 0
    )
    return int(present | (mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER if v.inputs.manual_control else 0))


def _health(v: Vehicle, s: TelemetryState) -> int:
    health = _present(v, s)
    if not s.xy_valid[v.row]:
        health &= ~mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION
    return int(health | mavlink.MAV_SYS_STATUS_PREARM_CHECK) if v.ready_to_arm else health


def _system_time(out: Records, rows: Rows) -> None:
    out["time_boot_ms"] = rows.s.ms


def _has_horizontal(v: Vehicle, s: TelemetryState) -> bool:
    return s.xy_valid[v.row]


def _is_aligned(v: Vehicle, _: TelemetryState) -> bool:
    """Return whether the estimator is initialised. From then on its position is sent, even while the position is not valid, as in PX4."""
    return v.aligned


def _has_global(v: Vehicle, s: TelemetryState) -> bool:
    return v.origin is not None and s.xy_valid[v.row]


def _batched(msgid: int, fill: Any, available: Any = None, **constants: Any) -> tuple[int, BatchedMessage]:
    return msgid, BatchedMessage(mavlink_records.record(msgid, **constants), fill, available)


_HEART = {
    "autopilot": mavlink.MAV_AUTOPILOT_PX4,
    "version": 3,
}
# PX4 sends the velocity in NED and declares it in child_frame_id.
_FRAMES = {"frame": mavlink.MAV_FRAME_LOCAL_NED, "child": mavlink.MAV_FRAME_LOCAL_NED}
_UNKNOWN = {
    "pose_variance": _NAN,
    "velocity_variance": _NAN,
    "estimator": mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
}

BATCHED: dict[int, BatchedMessage] = dict(
    (
        _batched(mavlink_records.HEARTBEAT, _heartbeat, **_HEART),
        _batched(mavlink_records.SYS_STATUS, _sys_status, load=100),
        _batched(mavlink_records.SYSTEM_TIME, _system_time),
        _batched(mavlink_records.ATTITUDE, _attitude),
        _batched(mavlink_records.ATTITUDE_QUATERNION, _attitude_quaternion),
        _batched(mavlink_records.LOCAL_POSITION_NED, _local_position, _is_aligned),
        _batched(mavlink_records.GLOBAL_POSITION_INT, _global_position, _has_global),
        _batched(mavlink_records.SERVO_OUTPUT_RAW, _servo_output_raw, servos=900),
        _batched(mavlink_records.VFR_HUD, _vfr_hud),
        _batched(mavlink_records.ATTITUDE_TARGET, _attitude_target),
        _batched(mavlink_records.POSITION_TARGET, _position_target, frame=mavlink.MAV_FRAME_LOCAL_NED),
        _batched(mavlink_records.HIGHRES_IMU, _highres_imu, temperature=25.0, updated=0x1BFF),
        _batched(mavlink_records.TIMESYNC, _timesync),
        _batched(mavlink_records.ALTITUDE, _altitude, heights=_NAN),
        _batched(mavlink_records.EXTENDED_SYS_STATE, _extended_sys_state),
        _batched(mavlink_records.ODOMETRY, _odometry, _has_horizontal, **_FRAMES, **_UNKNOWN),
    )
)
