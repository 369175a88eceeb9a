"""Which messages an autopilot sends by itself, how often, and how each is filled in.

Rates are those of PX4's onboard link as measured on v1.16 SITL, in simulation time. What is sent often is filled in for many
vehicles at once (often.py); the rest is here: a builder takes the vehicle's face and the snapshot of this step and returns a
message, or None while it has nothing to say.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.atmosphere import pressure_hpa
from arena.autopilot.commander import Mode
from arena.autopilot.mavlink.telemetry_batch import OFTEN, globe
from arena.autopilot.mavlink.telemetry_state import Snapshot
from arena.wire.mavlink_frame import MavlinkSender
from arena.wire.px4_mode import ADVANCED, AVAILABLE_MODES, CURRENT_MODE, AvailableMode, CurrentMode

if TYPE_CHECKING:
    from arena.autopilot.mavlink.mavlink_interface import Face

Builder = Callable[["Face", Snapshot], Any]

# MAV_STANDARD_MODE of those that have one
STANDARD = {Mode.RTL: 5, Mode.MISSION: 6, Mode.LAND: 7, Mode.DESCEND: 7, Mode.TAKEOFF: 8}
_SELECTABLE = {
    Mode.MISSION: "",
    Mode.HOLD: "Hold",
    Mode.RTL: "",
    Mode.OFFBOARD: "Offboard",
    Mode.TAKEOFF: "",
    Mode.LAND: "",
}
_NAN = math.nan


class AllModes:
    """AVAILABLE_MODES, one after the other, in place of a message."""

    def pack(self, sender: MavlinkSender) -> bytes:
        """The frames of all modes that can be chosen, in PX4's order; the sequence number of `sender` advances."""
        frames = []
        for k, (mode, name) in enumerate(_SELECTABLE.items()):
            given = AvailableMode(
                custom_mode=mode.custom_mode,
                index=k + 1,
                count=len(_SELECTABLE),
                properties=ADVANCED,
                standard=STANDARD.get(mode, 0),
                name=name,
            )
            sender.seq = (sender.seq + (k > 0)) % 256
            frames.append(given.pack(sender))
        return b"".join(frames)


def _us(s: Snapshot) -> int:
    return int(s.now_s * 1e6)


def battery_status(f: Face, s: Snapshot) -> Any:
    i = f.i
    cells = [min(max(int(1e3 * s.battery_v[i]), 0), 65534)] + [65535] * 9
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        cells,
        _centi(s.battery_a[i]),
        int(s.consumed_mah[i]),
        -1,
        round(100 * s.battery[i]),
        0,
        _charge_state(f, s),
    )


def _charge_state(f: Face, s: Snapshot) -> int:
    """MAV_BATTERY_CHARGE_STATE: 1 well, then by the thresholds that warn."""
    limits, left = f.limits, s.battery[f.i]
    if limits is None:
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_UNDEFINED)
    return 1 + sum(bool(left <= t) for t in (limits.bat_low_thr, limits.bat_crit_thr, limits.bat_emergen_thr))


def current_mode(f: Face, s: Snapshot) -> Any:
    mode, wanted = f.commander.mode, f.commander.intended
    return CurrentMode(
        custom_mode=mode.custom_mode, intended=wanted.custom_mode, standard=STANDARD.get(mode, 0)
    )


def available_modes(f: Face, s: Snapshot) -> Any:
    return AllModes()


def scaled_pressure(f: Face, s: Snapshot) -> Any:
    return mavlink.MAVLink_scaled_pressure_message(s.ms, pressure_hpa(s.baro_alt_m[f.i]), 0.0, 2500)


def ping(f: Face, s: Snapshot) -> Any:
    f.pings += 1
    return mavlink.MAVLink_ping_message(_us(s), f.pings, 0, 0)


def home_position(f: Face, s: Snapshot) -> Any:
    if f.origin is None or f.home_n is None:
        return None
    place = (int(x[0]) for x in globe(np.array([f.origin]), np.array([f.home_n])))
    return mavlink.MAVLink_home_position_message(
        *place, *f.home_n, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, _us(s)
    )


def gps_global_origin(f: Face, s: Snapshot) -> Any:
    if f.origin is None:
        return None
    lat, lon, alt = f.origin
    return mavlink.MAVLink_gps_global_origin_message(round(lat * 1e7), round(lon * 1e7), _mm(alt), _us(s))


def estimator_status(f: Face, s: Snapshot) -> Any:
    i = f.i
    flags = mavlink.ESTIMATOR_ATTITUDE if f.aligned else 0
    if s.xy_valid[i]:
        flags |= (
            mavlink.ESTIMATOR_VELOCITY_HORIZ
            | mavlink.ESTIMATOR_POS_HORIZ_REL
            | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
        )
        flags |= mavlink.ESTIMATOR_POS_HORIZ_ABS if f.origin else 0
    if s.z_valid[i]:
        flags |= mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS
    ratio, var = s.est.test_ratio[i], s.variance[i]
    return mavlink.MAVLink_estimator_status_message(
        _us(s),
        flags,
        0.0,
        ratio[0],
        ratio[0],
        ratio[1],
        _NAN,
        _NAN,
        math.sqrt(var[0] + var[1]),
        math.sqrt(var[2]),
    )


def autopilot_version(f: Face, s: Snapshot) -> Any:
    bits = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    )
    # 1.16.0 is the contract that is kept, not what this is: the custom version spells it.
    name = list(b"builtin\0")
    return mavlink.MAVLink_autopilot_version_message(
        bits, 0x011000FF, 0, 0, 0, name, [0] * 8, name, 0, 0, f.i + 1
    )


BUILDERS: dict[int, Builder] = {
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_status,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: scaled_pressure,
    mavlink.MAVLINK_MSG_ID_PING: ping,
    CURRENT_MODE: current_mode,
    AVAILABLE_MODES: available_modes,
}
TOLD = BUILDERS.keys() | OFTEN.keys()
"""All that can be told."""

_SLOW = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
}
_ONBOARD = _SLOW | {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 30.0,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 10.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 1.0,
    mavlink.MAVLINK_MSG_ID_PING: 1.0,
    CURRENT_MODE: 0.5,
}

# Messages per second by link. Vision and panic links carry what their one partner decides on.
LINK_RATES: dict[str, dict[int, float]] = {
    "router": _ONBOARD,
    "vision": _SLOW
    | {mavlink.MAVLINK_MSG_ID_HOME_POSITION: 1.0, mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0},
    "panic": _SLOW | {mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0},
}


def _mm(metres: float) -> int:
    """As far as an int32 goes."""
    return int(min(max(metres * 1e3, -(2.0**31)), 2.0**31 - 1.0))


def _centi(amperes: float) -> int:
    """As far as an int16 goes."""
    return int(min(max(100.0 * amperes, -32768.0), 32767.0)) if math.isfinite(amperes) else 0
