"""Telemetry streams: default rate of each message on each link, and functions that build the messages that no kernel packs.

The rates are those of PX4's modes ONBOARD and NORMAL, measured on v1.16 SITL in simulation time. `packed_messages` is the
table of the messages that a kernel packs. Each function here builds the message of one vehicle;
it returns None if the vehicle has no valid content for it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.flight_modes import STANDARD_MODES, Mode
from arena.autopilot.mavlink import status_messages
from arena.autopilot.mavlink.packed_messages import PACKED
from arena.autopilot.mavlink.telemetry_state import TelemetryState
from arena.autopilot.vehicle import Vehicle
from arena.wire.mavlink_frame import MavlinkSender
from arena.wire.px4_messages import CURRENT_EVENT_SEQUENCE, ESC_INFO, ESC_STATUS
from arena.wire.px4_mode import ADVANCED, AVAILABLE_MODES, CURRENT_MODE, AvailableMode

Builder = Callable[[Vehicle, TelemetryState], Any]

_SELECTABLE = {
    Mode.MANUAL: "Manual",
    Mode.ALTCTL: "",
    Mode.POSCTL: "",
    Mode.MISSION: "",
    Mode.HOLD: "Hold",
    Mode.RTL: "",
    Mode.ACRO: "Acro",
    Mode.OFFBOARD: "Offboard",
    Mode.STABILIZED: "Stabilized",
    Mode.TAKEOFF: "",
    Mode.LAND: "",
}


class AllModes:
    """Queue entry for all AVAILABLE_MODES messages of a link, one per selectable mode."""

    def pack(self, sender: MavlinkSender) -> bytes:
        """Return one AVAILABLE_MODES frame per selectable mode, in PX4's order.

        Advances the sequence number of `sender`.
        """
        frames = []
        for k, (mode, name) in enumerate(_SELECTABLE.items()):
            given = AvailableMode(
                custom_mode=mode.custom_mode,
                index=k + 1,
                count=len(_SELECTABLE),
                properties=0 if mode in (Mode.ALTCTL, Mode.POSCTL) else ADVANCED,
                standard=STANDARD_MODES.get(mode, 0),
                name=name,
            )
            sender.seq = (sender.seq + (k > 0)) % 256
            frames.append(given.pack(sender))
        return b"".join(frames)


def available_modes(v: Vehicle, s: TelemetryState) -> Any:
    return AllModes()


def gps_global_origin(v: Vehicle, now: float) -> Any:
    """Return the message GPS_GLOBAL_ORIGIN, or None if no origin is set. now: time since boot [s]."""
    if v.origin is None:
        return None
    lat, lon, alt, _ = v.origin
    return mavlink.MAVLink_gps_global_origin_message(
        round(lat * 1e7),
        round(lon * 1e7),
        int(alt * 1e3),
        int(now * 1e6),
    )


def autopilot_version(v: Vehicle, s: TelemetryState) -> Any:
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
        | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
        | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    )
    # 1.16.0 is the PX4 version whose contract is kept; the custom version identifies the built-in autopilot.
    name = list(b"builtin\0")
    return mavlink.MAVLink_autopilot_version_message(
        bits, 0x011000FF, 0, 0, 0, name, [0] * 8, name, 0, 0, v.row + 1
    )


BUILDERS: dict[int, Builder] = {
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: lambda v, s: gps_global_origin(v, s.now_s),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    AVAILABLE_MODES: available_modes,
    **status_messages.BUILDERS,
}
SUPPORTED = BUILDERS.keys() | PACKED.keys()
"""Ids of all messages that can be streamed or requested."""

_SLOW = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    CURRENT_EVENT_SEQUENCE: 1.0 / 3.0,
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
    ESC_INFO: 10.0,
    ESC_STATUS: 10.0,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 0.5,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 20.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: 1.0,
    mavlink.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
}

_NORMAL = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 15.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 10.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 5.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 2.0,
    mavlink.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: 2.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 1.5,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: 1.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 1.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    ESC_INFO: 1.0,
    ESC_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    CURRENT_MODE: 0.5,
    CURRENT_EVENT_SEQUENCE: 1.0 / 3.0,
    mavlink.MAVLINK_MSG_ID_PING: 0.1,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 0.1,
}

# Messages per second, by link and message id. The vision and panic links carry only what their one partner
# needs.
GROUND = "ground"
"""Name of the link for ground stations."""
LINK_RATES: dict[str, dict[int, float]] = {
    "router": _ONBOARD,
    GROUND: _NORMAL,
    "vision": _SLOW
    | {mavlink.MAVLINK_MSG_ID_HOME_POSITION: 1.0, mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0},
    "panic": _SLOW | {mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0},
}
