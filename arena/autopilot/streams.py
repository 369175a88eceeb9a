"""Which messages an autopilot sends by itself, how often, and how each is filled in.

Rates are those of PX4's onboard link as measured on v1.16 SITL, in simulation time. Each builder takes the vehicle's face and
the snapshot of this step and returns a message, or None while it has nothing to say.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from arena.atmosphere import pressure_hpa
from arena.autopilot.commander import Mode
from arena.autopilot.snapshot import Snapshot
from arena.wire.modes import ADVANCED, AVAILABLE_MODES, CURRENT_MODE, AvailableMode, CurrentMode, Voice

if TYPE_CHECKING:
    from arena.autopilot.face import Face

Builder = Callable[["Face", Snapshot], Any]

EARTH_RADIUS_M = 6_371_000.0
# MAV_STANDARD_MODE of those that have one
STANDARD = {Mode.RTL: 5, Mode.MISSION: 6, Mode.LAND: 7, Mode.DESCEND: 7, Mode.TAKEOFF: 8}
_SELECTABLE = {Mode.MISSION: "", Mode.HOLD: "Hold", Mode.RTL: "", Mode.OFFBOARD: "Offboard", Mode.TAKEOFF: "", Mode.LAND: ""}
_NAN = math.nan


class AllModes:
    """AVAILABLE_MODES, one after the other, in place of a message."""

    def pack(self, voice: Voice) -> bytes:
        """The frames of all modes that can be chosen, in PX4's order; `voice` counts on."""
        frames = []
        for k, (mode, name) in enumerate(_SELECTABLE.items()):
            given = AvailableMode(
                custom_mode=mode.custom_mode, index=k + 1, count=len(_SELECTABLE), properties=ADVANCED,
                standard=STANDARD.get(mode, 0), name=name,
            )  # fmt: skip
            voice.seq = (voice.seq + (k > 0)) % 256
            frames.append(given.pack(voice))
        return b"".join(frames)


def _ms(s: Snapshot) -> int:
    return int(s.now_s * 1e3) & 0xFFFFFFFF


def _us(s: Snapshot) -> int:
    return int(s.now_s * 1e6)


def heartbeat(f: Face, s: Snapshot) -> Any:
    c = f.commander
    base = 1 | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if c.armed else 0)
    base |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    if c.mode is not Mode.OFFBOARD:
        base |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    status = mavlink.MAV_STATE_CRITICAL if c.failsafe else mavlink.MAV_STATE_ACTIVE if c.armed else mavlink.MAV_STATE_STANDBY
    if c.mode is Mode.TERMINATE:
        status = mavlink.MAV_STATE_FLIGHT_TERMINATION
    kind, autopilot = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, base, c.mode.custom_mode, status, 3)


def attitude(f: Face, s: Snapshot) -> Any:
    return mavlink.MAVLink_attitude_message(_ms(s), *s.rpy[f.i], *s.omega_b[f.i])


def attitude_quaternion(f: Face, s: Snapshot) -> Any:
    return mavlink.MAVLink_attitude_quaternion_message(_ms(s), *s.q_nb[f.i], *s.omega_b[f.i], [0.0, 0.0, 0.0, 0.0])


def local_position_ned(f: Face, s: Snapshot) -> Any:
    if not (s.xy_valid[f.i] or s.z_valid[f.i]):
        return None
    return mavlink.MAVLink_local_position_ned_message(_ms(s), *s.p_n[f.i], *s.v_n[f.i])


def odometry(f: Face, s: Snapshot) -> Any:
    if not s.xy_valid[f.i]:
        return None
    i, var = f.i, s.variance[f.i]
    pose, twist = [_NAN] * 21, [_NAN] * 21
    pose[0], pose[6], pose[11], pose[15], pose[18], pose[20] = var[0:6]
    twist[0], twist[6], twist[11] = var[6:9]
    # PX4 tells the velocity along north, east and down, and says so in child_frame_id.
    return mavlink.MAVLink_odometry_message(
        _us(s), mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_NED, *s.p_n[i], s.q_nb[i], *s.v_n[i], *s.omega_b[i], pose,
        twist, s.reset_counter[i] & 0xFF, mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT, 0,
    )  # fmt: skip


def highres_imu(f: Face, s: Snapshot) -> Any:
    i = f.i
    height = s.baro_alt_m[i]
    return mavlink.MAVLink_highres_imu_message(
        _us(s), *s.accel_b[i], *s.gyro_b[i], *s.mag_b[i], pressure_hpa(height), 0.0, height, 25.0, 0x1BFF, 0
    )


def global_position_int(f: Face, s: Snapshot) -> Any:
    if f.origin is None or not s.xy_valid[f.i]:
        return None
    i = f.i
    lat, lon, alt = f.global_from_local(s.p_n[i])
    v = s.v_n[i]
    heading = int(math.degrees(s.rpy[i][2]) % 360.0 * 100.0) % 36000
    above_home = -s.p_n[i][2] + (f.home_n[2] if f.home_n else 0.0)
    return mavlink.MAVLink_global_position_int_message(
        _ms(s), lat, lon, _mm(alt), _mm(above_home), *(_clip16(100.0 * x) for x in v), heading
    )


def altitude(f: Face, s: Snapshot) -> Any:
    up = -s.p_n[f.i][2]
    amsl = up + f.origin[2] if f.origin else _NAN
    relative = up + f.home_n[2] if f.home_n else _NAN
    return mavlink.MAVLink_altitude_message(_us(s), s.baro_alt_m[f.i], amsl, up, relative, _NAN, _NAN)


def attitude_target(f: Face, s: Snapshot) -> Any:
    i = f.i
    return mavlink.MAVLink_attitude_target_message(_ms(s), 0, s.q_sp[i], *s.omega_sp[i], s.thrust[i])


def position_target_local_ned(f: Face, s: Snapshot) -> Any:
    i = f.i
    values = (*s.p_sp[i], *s.v_sp[i], *s.a_sp[i])
    mask = sum(1 << k for k, x in enumerate(values) if not math.isfinite(x))
    mask |= 0 if math.isfinite(s.yaw_sp[i]) else mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    mask |= 0 if math.isfinite(s.yaw_rate_sp[i]) else mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
    return mavlink.MAVLink_position_target_local_ned_message(
        _ms(s), mavlink.MAV_FRAME_LOCAL_NED, mask, *values, s.yaw_sp[i], s.yaw_rate_sp[i]
    )


def servo_output_raw(f: Face, s: Snapshot) -> Any:
    pwm = [int(1000 + 1000 * u) if f.commander.armed else 900 for u in s.motors[f.i]]
    pwm = (pwm + [900] * 8)[:8]
    return mavlink.MAVLink_servo_output_raw_message(_us(s) & 0xFFFFFFFF, 0, *pwm)


def timesync(f: Face, s: Snapshot) -> Any:
    return mavlink.MAVLink_timesync_message(0, int(s.now_s * 1e9))


def vfr_hud(f: Face, s: Snapshot) -> Any:
    i = f.i
    v = s.v_n[i]
    ground = math.hypot(v[0], v[1])
    alt = -s.p_n[i][2] + (f.origin[2] if f.origin else 0.0)
    heading_deg = int(math.degrees(s.rpy[i][2]) % 360)
    return mavlink.MAVLink_vfr_hud_message(ground, ground, heading_deg, int(100 * s.thrust[i]), alt, -v[2])


def extended_sys_state(f: Face, s: Snapshot) -> Any:
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, f.landed_state)


_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE | mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY | mavlink.MAV_SYS_STATUS_AHRS
)  # fmt: skip


def sys_status(f: Face, s: Snapshot) -> Any:
    i = f.i
    present = health = _SENSORS
    if f.origin is not None and s.xy_valid[i]:
        # SDKs read "the global position is good" from this bit, whatever gives it.
        present, health = present | mavlink.MAV_SYS_STATUS_SENSOR_GPS, health | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    if not s.xy_valid[i]:
        health &= ~mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION
    if f.ready_to_arm:
        health |= mavlink.MAV_SYS_STATUS_PREARM_CHECK
    volts = min(max(int(1e3 * s.battery_v[i]), 0), 65534)
    return mavlink.MAVLink_sys_status_message(
        present, present, health, 100, volts, _clip16(100 * s.battery_a[i]), round(100 * s.battery[i]), 0, 0, 0, 0, 0, 0
    )


def system_time(f: Face, s: Snapshot) -> Any:
    return mavlink.MAVLink_system_time_message(0, _ms(s))


def battery_status(f: Face, s: Snapshot) -> Any:
    i = f.i
    cells = [min(max(int(1e3 * s.battery_v[i]), 0), 65534)] + [65535] * 9
    return mavlink.MAVLink_battery_status_message(
        0, mavlink.MAV_BATTERY_FUNCTION_ALL, mavlink.MAV_BATTERY_TYPE_LIPO, 32767, cells, _clip16(100 * s.battery_a[i]), -1, -1,
        round(100 * s.battery[i]), 0, _charge_state(f, s),
    )  # fmt: skip


def _charge_state(f: Face, s: Snapshot) -> int:
    """MAV_BATTERY_CHARGE_STATE: 1 well, then by the thresholds that warn."""
    limits, left = f.limits, s.battery[f.i]
    if limits is None:
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_UNDEFINED)
    return 1 + sum(left <= t for t in (limits.bat_low_thr, limits.bat_crit_thr, limits.bat_emergen_thr))


def current_mode(f: Face, s: Snapshot) -> Any:
    mode, wanted = f.commander.mode, f.commander.intended
    return CurrentMode(custom_mode=mode.custom_mode, intended=wanted.custom_mode, standard=STANDARD.get(mode, 0))


def available_modes(f: Face, s: Snapshot) -> Any:
    return AllModes()


def scaled_pressure(f: Face, s: Snapshot) -> Any:
    return mavlink.MAVLink_scaled_pressure_message(_ms(s), pressure_hpa(s.baro_alt_m[f.i]), 0.0, 2500)


def ping(f: Face, s: Snapshot) -> Any:
    f.pings += 1
    return mavlink.MAVLink_ping_message(_us(s), f.pings, 0, 0)


def home_position(f: Face, s: Snapshot) -> Any:
    if f.origin is None or f.home_n is None:
        return None
    lat, lon, alt = f.global_from_local(f.home_n)
    return mavlink.MAVLink_home_position_message(lat, lon, _mm(alt), *f.home_n, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, _us(s))


def gps_global_origin(f: Face, s: Snapshot) -> Any:
    if f.origin is None:
        return None
    lat, lon, alt = f.origin
    return mavlink.MAVLink_gps_global_origin_message(round(lat * 1e7), round(lon * 1e7), _mm(alt), _us(s))


def estimator_status(f: Face, s: Snapshot) -> Any:
    i = f.i
    flags = mavlink.ESTIMATOR_ATTITUDE if f.aligned else 0
    if s.xy_valid[i]:
        flags |= mavlink.ESTIMATOR_VELOCITY_HORIZ | mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
        flags |= mavlink.ESTIMATOR_POS_HORIZ_ABS if f.origin else 0
    if s.z_valid[i]:
        flags |= mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS
    ratio, var = s.test_ratio[i], s.variance[i]
    return mavlink.MAVLink_estimator_status_message(
        _us(s), flags, 0.0, ratio[0], ratio[0], ratio[1], _NAN, _NAN, math.sqrt(var[0] + var[1]), math.sqrt(var[2])
    )


def autopilot_version(f: Face, s: Snapshot) -> Any:
    bits = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    )  # fmt: skip
    # 1.16.0 is the contract that is kept, not what this is: the custom version spells it.
    name = list(b"builtin\0")
    return mavlink.MAVLink_autopilot_version_message(bits, 0x011000FF, 0, 0, 0, name, [0] * 8, name, 0, 0, f.i + 1)


BUILDERS: dict[int, Builder] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat, mavlink.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: system_time, mavlink.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: servo_output_raw,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin, mavlink.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: attitude_target,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position_target_local_ned,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: highres_imu, mavlink.MAVLINK_MSG_ID_TIMESYNC: timesync,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: altitude, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version, mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_status,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: home_position, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: odometry, mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: scaled_pressure,
    mavlink.MAVLINK_MSG_ID_PING: ping, CURRENT_MODE: current_mode, AVAILABLE_MODES: available_modes,
}  # fmt: skip

_SLOW = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0, mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
}  # fmt: skip
_ONBOARD = _SLOW | {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0, mavlink.MAVLINK_MSG_ID_ODOMETRY: 30.0,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 10.0, mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 10.0, mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5, mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0, mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 1.0, mavlink.MAVLINK_MSG_ID_PING: 1.0,
    CURRENT_MODE: 0.5,
}  # fmt: skip

# Messages per second by link. Vision and panic links carry what their one partner decides on.
LINK_RATES: dict[str, dict[int, float]] = {
    "router": _ONBOARD,
    "vision": _SLOW | {mavlink.MAVLINK_MSG_ID_HOME_POSITION: 1.0, mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0},
    "panic": _SLOW | {mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0},
}


def _clip16(x: float) -> int:
    return int(min(max(x, -32768.0), 32767.0)) if math.isfinite(x) else 0


def _mm(metres: float) -> int:
    """As far as an int32 goes."""
    return int(min(max(metres * 1e3, -(2.0**31)), 2.0**31 - 1.0))
