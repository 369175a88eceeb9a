"""The messages that are sent often, filled in for all vehicles that send one at this step: a record each, in a few numpy calls.

Each filler writes into the records of a message (their fields: wire/onboard.py) the rows of the fleet that are asked for.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.atmosphere import pressure_hpa
from arena.autopilot.commander import Mode
from arena.autopilot.mavlink.telemetry_state import Snapshot
from arena.geometry import globe_from_local
from arena.wire import mavlink_records
from arena.wire.mavlink_records import Records

if TYPE_CHECKING:
    from arena.autopilot.mavlink.mavlink_interface import Face

Array = NDArray[np.float64]

_NAN = math.nan
_INT32 = (-(2.0**31), 2.0**31 - 1.0)
_INT16 = (-32768.0, 32767.0)
_DIAGONAL = np.array((0, 6, 11, 15, 18, 20))  # of the row-major upper triangle


@dataclass(slots=True)
class Rows:
    """The vehicles that send a message now: their faces, their rows in the fleet's arrays, and these arrays."""

    faces: list[Face]
    i: NDArray[np.intp]
    s: Snapshot


@dataclass(frozen=True, slots=True)
class Often:
    """blank: a record with what never changes; fill: writes the rest; has: whether a vehicle has it to say, None: always."""

    blank: Records
    fill: Callable[[Records, Rows], None]
    has: Callable[[Face, Snapshot], bool] | None = None


def payloads(asked: Iterable[tuple[Face, int]], s: Snapshot) -> dict[int, dict[int, bytes]]:
    """(face, message id), of any messages, once or more -> of those that are made here, by message id: row to payload."""
    senders: defaultdict[int, dict[int, Face]] = defaultdict(dict)
    for f, msgid in asked:
        senders[msgid][f.i] = f
    return {msgid: _filled(OFTEN[msgid], faces, s) for msgid, faces in senders.items() if msgid in OFTEN}


def _filled(often: Often, faces: dict[int, Face], s: Snapshot) -> dict[int, bytes]:
    if often.has is not None:
        faces = {i: f for i, f in faces.items() if often.has(f, s)}
        if not faces:
            return {}
    records = often.blank.repeat(len(faces))
    often.fill(records, Rows(list(faces.values()), np.array(list(faces), np.intp), s))
    return dict(zip(faces, mavlink_records.payloads(records), strict=True))


def globe(origins: Array, p_n: Array) -> tuple[Array, Array, Array]:
    """origins: latitude, longitude [deg], altitude [m]; p_n [m] [NED], both (n, 3) -> the same of p_n: [1e-7 deg] twice, [mm].

    As far as the numbers of the wire go.
    """
    lat0, lon0, alt0 = origins.T
    lat, lon = globe_from_local(lat0, lon0, p_n[:, 0], p_n[:, 1])
    lat = np.minimum(np.maximum(lat, -90.0), 90.0)
    return (
        np.rint(lat * 1e7),
        np.rint(((lon + 180.0) % 360.0 - 180.0) * 1e7),
        _within((alt0 - p_n[:, 2]) * 1e3, _INT32),
    )


def _within(values: Array, limits: tuple[float, float]) -> Array:
    return np.asarray(np.minimum(np.maximum(values, limits[0]), limits[1]))


def _heartbeat(out: Records, rows: Rows) -> None:
    out["custom_mode"] = [f.commander.mode.custom_mode for f in rows.faces]
    out["base_mode"] = [_base_mode(f) for f in rows.faces]
    out["status"] = [_status(f) for f in rows.faces]


def _base_mode(f: Face) -> int:
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
        mavlink.MAV_MODE_FLAG_SAFETY_ARMED if f.commander.armed else 0
    )
    base |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    if f.commander.mode is not Mode.OFFBOARD:
        base |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    return int(base)


def _status(f: Face) -> int:
    c = f.commander
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
    p_n = s.p_n[i]
    home_d = np.array([f.home_n[2] if f.home_n else 0.0 for f in rows.faces])
    out["time_boot_ms"] = s.ms
    out["lat"], out["lon"], out["alt"] = globe(np.array([f.origin for f in rows.faces]), p_n)
    out["relative_alt"] = _within((home_d - p_n[:, 2]) * 1e3, _INT32)
    out["v_n"] = _within(s.v_n[i] * 100.0, _INT16)
    out["heading"] = np.degrees(s.rpy[i, 2]) % 360.0 * 100.0 % 36000.0


def _altitude(out: Records, rows: Rows) -> None:
    up = -rows.s.p_n[rows.i, 2]
    heights = out["heights"]
    out["time_usec"] = rows.s.us
    heights[:, 0], heights[:, 2] = rows.s.baro_alt_m[rows.i], up
    heights[:, 1] = up + [f.origin[2] if f.origin else _NAN for f in rows.faces]
    heights[:, 3] = up + [f.home_n[2] if f.home_n else _NAN for f in rows.faces]


def _attitude_target(out: Records, rows: Rows) -> None:
    i, s = rows.i, rows.s
    out["time_boot_ms"] = s.ms
    out["q_nb"], out["omega_b"], out["thrust"] = s.cascade.q_sp[i], s.cascade.omega_sp[i], s.thrust[i]


_IGNORE = np.array(
    [1 << k for k in (*range(9), 10, 11)]
)  # POSITION_TARGET_TYPEMASK, of p, v, a, yaw and its rate


def _position_target(out: Records, rows: Rows) -> None:
    values = rows.s.setpoint[rows.i]
    out["time_boot_ms"] = rows.s.ms
    out["values"], out["mask"] = values, ~np.isfinite(values) @ _IGNORE


def _servo_output_raw(out: Records, rows: Rows) -> None:
    motors = rows.s.motors[rows.i, :8]
    armed = np.array([[f.commander.armed] for f in rows.faces])
    out["time_usec"] = rows.s.us & 0xFFFFFFFF
    out["servos"][:, : motors.shape[1]] = np.where(armed, 1000.0 + 1000.0 * motors, 900.0)


def _timesync(out: Records, rows: Rows) -> None:
    out["ts1"] = int(rows.s.now_s * 1e9)


def _vfr_hud(out: Records, rows: Rows) -> None:
    i, s = rows.i, rows.s
    v = s.v_n[i]
    out["airspeed"] = out["groundspeed"] = np.hypot(v[:, 0], v[:, 1])
    out["alt"] = [f.origin[2] if f.origin else 0.0 for f in rows.faces] - s.p_n[i, 2]
    out["climb"] = -v[:, 2]
    out["heading"], out["throttle"] = np.degrees(s.rpy[i, 2]) % 360.0, 100.0 * s.thrust[i]


def _extended_sys_state(out: Records, rows: Rows) -> None:
    out["landed"] = [f.landed_state for f in rows.faces]


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
    out["present"] = out["enabled"] = [_present(f, s) for f in rows.faces]
    out["health"] = [_health(f, s) for f in rows.faces]
    out["voltage"] = _within(s.battery_v[i] * 1e3, (0.0, 65534.0))
    out["current"] = _within(s.battery_a[i] * 100.0, _INT16)
    out["remaining"] = np.rint(100.0 * s.battery[i])


def _present(f: Face, s: Snapshot) -> int:
    # SDKs read "the global position is good" from the satellites' bit, whatever gives it.
    present = _SENSORS | (
        mavlink.MAV_SYS_STATUS_SENSOR_GPS if f.origin is not None and s.xy_valid[f.i] else 0
    )
    return int(present | (mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER if f.sensed and f.sensed.sticks else 0))


def _health(f: Face, s: Snapshot) -> int:
    health = _present(f, s)
    if not s.xy_valid[f.i]:
        health &= ~mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION
    return int(health | mavlink.MAV_SYS_STATUS_PREARM_CHECK) if f.ready_to_arm else health


def _system_time(out: Records, rows: Rows) -> None:
    out["time_boot_ms"] = rows.s.ms


def _knows_position(f: Face, s: Snapshot) -> bool:
    return s.xy_valid[f.i]


def _knows_some_position(f: Face, s: Snapshot) -> bool:
    return s.xy_valid[f.i] or s.z_valid[f.i]


def _knows_place(f: Face, s: Snapshot) -> bool:
    return f.origin is not None and s.xy_valid[f.i]


def _often(msgid: int, fill: Any, has: Any = None, **constants: Any) -> tuple[int, Often]:
    return msgid, Often(mavlink_records.record(msgid, **constants), fill, has)


_HEART = {"type": mavlink.MAV_TYPE_QUADROTOR, "autopilot": mavlink.MAV_AUTOPILOT_PX4, "version": 3}
# PX4 tells the velocity along north, east and down, and says so in child_frame_id.
_FRAMES = {"frame": mavlink.MAV_FRAME_LOCAL_NED, "child": mavlink.MAV_FRAME_LOCAL_NED}
_UNKNOWN = {
    "pose_variance": _NAN,
    "velocity_variance": _NAN,
    "estimator": mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
}

OFTEN: dict[int, Often] = dict(
    (
        _often(mavlink_records.HEARTBEAT, _heartbeat, **_HEART),
        _often(mavlink_records.SYS_STATUS, _sys_status, load=100),
        _often(mavlink_records.SYSTEM_TIME, _system_time),
        _often(mavlink_records.ATTITUDE, _attitude),
        _often(mavlink_records.ATTITUDE_QUATERNION, _attitude_quaternion),
        _often(mavlink_records.LOCAL_POSITION_NED, _local_position, _knows_some_position),
        _often(mavlink_records.GLOBAL_POSITION_INT, _global_position, _knows_place),
        _often(mavlink_records.SERVO_OUTPUT_RAW, _servo_output_raw, servos=900),
        _often(mavlink_records.VFR_HUD, _vfr_hud),
        _often(mavlink_records.ATTITUDE_TARGET, _attitude_target),
        _often(mavlink_records.POSITION_TARGET, _position_target, frame=mavlink.MAV_FRAME_LOCAL_NED),
        _often(mavlink_records.HIGHRES_IMU, _highres_imu, temperature=25.0, updated=0x1BFF),
        _often(mavlink_records.TIMESYNC, _timesync),
        _often(mavlink_records.ALTITUDE, _altitude, heights=_NAN),
        _often(mavlink_records.EXTENDED_SYS_STATE, _extended_sys_state),
        _often(mavlink_records.ODOMETRY, _odometry, _knows_position, **_FRAMES, **_UNKNOWN),
    )
)
