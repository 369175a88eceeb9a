"""Telemetry messages that a kernel packs for the built-in autopilots: which quantity each field contains.

The kernel `telemetry_packing` computes the quantities and packs the frames. pymavlink's dialect defines the layouts.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.kernels.arrays import integers, view
from arena.kernels.payload_writer import KINDS, PayloadWriter
from arena.kernels.telemetry_quantities import BITS, COLUMNS, GROUP_OF, SIZES, VALUES
from arena.wire.mavlink_frame import SEEDS
from arena.wire.mavlink_layout import layout, payload_bytes
from arena.wire.px4_messages import CURRENT_EVENT_SEQUENCE, ESC_INFO, ESC_STATUS
from arena.wire.px4_mode import CURRENT_MODE

Array = NDArray[np.float64]
Content = str | float | tuple[str | float, ...]
_NAN = float("nan")
_EXACT = 2.0**53  # integers up to this size are exact in a float

_UNKNOWN_TEMPERATURE = 32767
_NO_CELL = 65535
_BOOT: dict[str, Content] = {"time_boot_ms": "time_ms"}
_TIME: dict[str, Content] = {"time_usec": "time_us"}
_RATES = "rollspeed pitchspeed yawspeed"
FREQUENT: dict[int, dict[str, Content]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: {
        "type": "mav_type",
        "autopilot": mavlink.MAV_AUTOPILOT_PX4,
        "base_mode": "base_mode",
        "custom_mode": "custom_mode",
        "system_status": "status",
        "mavlink_version": 3,
    },
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: {
        "onboard_control_sensors_present": "present",
        "onboard_control_sensors_enabled": "present",
        "onboard_control_sensors_health": "health",
        "load": 100,
        "voltage_battery": "voltage_mv",
        "current_battery": "current_ca",
        "battery_remaining": "remaining",
    },
    mavlink.MAVLINK_MSG_ID_ATTITUDE: {**_BOOT, "roll pitch yaw": "rpy", _RATES: "omega_b"},
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: {**_BOOT, "q1 q2 q3 q4": "q_nb", _RATES: "omega_b"},
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: {**_BOOT, "x y z": "p_n", "vx vy vz": "v_n"},
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: {
        **_BOOT,
        "lat": "lat",
        "lon": "lon",
        "alt": "alt_mm",
        "relative_alt": "relative_alt_mm",
        "vx vy vz": "velocity_cm_s",
        "hdg": "heading_cdeg",
    },
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: {
        # SDKs wait for a satellite fix before they fly to a global position. The position is the estimate.
        **_TIME,
        "fix_type": mavlink.GPS_FIX_TYPE_3D_FIX,
        "lat": "lat",
        "lon": "lon",
        "alt": "alt_mm",
        "eph": 65535,
        "epv": 65535,
        "vel": 65535,
        "cog": 65535,
        "satellites_visible": 255,
    },
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: {
        "time_usec": "time_us_32",
        " ".join(f"servo{k}_raw" for k in range(1, 9)): "servos",
    },
    mavlink.MAVLINK_MSG_ID_VFR_HUD: {
        "airspeed": "speed",
        "groundspeed": "speed",
        "alt": "alt",
        "climb": "climb",
        "heading": "heading_deg",
        "throttle": "throttle",
    },
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: {
        **_BOOT,
        "q": "q_sp",
        "body_roll_rate body_pitch_rate body_yaw_rate": "omega_sp",
        "thrust": "thrust",
    },
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: {
        **_BOOT,
        "x y z vx vy vz afx afy afz yaw yaw_rate": "setpoint",
        "type_mask": "ignored",
        "coordinate_frame": mavlink.MAV_FRAME_LOCAL_NED,
    },
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: {
        **_TIME,
        "xacc yacc zacc": "accel_b",
        "xgyro ygyro zgyro": "gyro_b",
        "xmag ymag zmag": "mag_b",
        "abs_pressure": "pressure_hpa",
        "pressure_alt": "baro_alt",
        "temperature": 25.0,
        "fields_updated": 0x1BFF,
    },
    mavlink.MAVLINK_MSG_ID_TIMESYNC: {"ts1": "time_ns"},
    ESC_INFO: {
        **_TIME,
        "counter": "esc_counter",
        "temperature": _UNKNOWN_TEMPERATURE,
        "index": "esc_first",
        "count": "esc_count",
        "info": "esc_online",
    },
    ESC_STATUS: {
        # The speeds are proportional to the motor commands, and the battery's current is divided among the ESCs.
        **_TIME,
        "rpm": "esc_rpm",
        "voltage": "esc_voltage",
        "current": "esc_current",
        "index": "esc_first",
    },
    mavlink.MAVLINK_MSG_ID_ALTITUDE: {
        **_TIME,
        "altitude_monotonic altitude_amsl altitude_local altitude_relative": "heights",
        "altitude_terrain": _NAN,
        "bottom_clearance": _NAN,
    },
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: {"landed_state": "landed"},
    mavlink.MAVLINK_MSG_ID_ODOMETRY: {
        **_TIME,
        # PX4 sends the velocity in NED and declares it in child_frame_id.
        "frame_id": mavlink.MAV_FRAME_LOCAL_NED,
        "child_frame_id": mavlink.MAV_FRAME_LOCAL_NED,
        "x y z": "p_n",
        "q": "q_nb",
        "vx vy vz": "v_n",
        _RATES: "omega_b",
        "pose_covariance": "pose_covariance",
        "velocity_covariance": "velocity_covariance",
        "reset_counter": "reset_counter",
        "estimator_type": mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    },
}
RARE: dict[int, dict[str, Content]] = {
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: {"time_unix_usec": "unix_us", **_BOOT},
    mavlink.MAVLINK_MSG_ID_PING: {**_TIME, "seq": "ping"},
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: {**_BOOT, "press_abs": "pressure_hpa", "temperature": 2500},
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: {
        "battery_function": mavlink.MAV_BATTERY_FUNCTION_ALL,
        "type": mavlink.MAV_BATTERY_TYPE_LIPO,
        "temperature": _UNKNOWN_TEMPERATURE,
        "voltages": ("voltage_mv", *[_NO_CELL] * 9),
        "current_battery": "current_ca",
        "current_consumed": "consumed_mah",
        "energy_consumed": -1,
        "battery_remaining": "remaining",
        "charge_state": "charge_state",
    },
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: {
        **_TIME,
        "flags": "estimator_flags",
        "pos_horiz_ratio": "ratio_position",
        "pos_vert_ratio": "ratio_position",
        "mag_ratio": "ratio_yaw",
        "hagl_ratio tas_ratio": (_NAN, _NAN),
        "pos_horiz_accuracy pos_vert_accuracy": "accuracies",
    },
    # The simulated rotors do not vibrate, and the simulated accelerometers do not clip.
    mavlink.MAVLINK_MSG_ID_VIBRATION: _TIME,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: {
        "time_usec": ("time_us_32", "time_us_high"),
        "latitude": "home_lat",
        "longitude": "home_lon",
        "altitude": "home_alt_mm",
        "x y z": ("home_north", "home_east", "home_d"),
        "q": (1.0, 0.0, 0.0, 0.0),
    },
    CURRENT_EVENT_SEQUENCE: {"sequence": "event_sequence", "flags": "event_flags"},
    CURRENT_MODE: {
        "custom_mode": "custom_mode",
        "intended_custom_mode": "intended_mode",
        "standard_mode": "standard_mode",
    },
}
"""Messages that are sent once a second or less by default, and are placed before the frequent ones in a datagram."""
PACKED = FREQUENT | RARE
"""Message id -> names of fields -> the quantity that these fields contain, or a constant, or one of these for each element.
All other fields are 0."""


def writers() -> tuple[list[float], list[PayloadWriter]]:
    """Return the constant field values of the packed messages, and a compiled encoder for each message."""
    constants: list[float] = []
    found, ranges = [], view(_ranges())
    for msgid, contents in PACKED.items():
        fields: list[tuple[int, int, int]] = []
        for names, content in contents.items():
            fields += _fields_of(msgid, names.split(), _columns(msgid, names, content, constants))
        table = integers(np.array(fields, np.int64))
        found.append(
            PayloadWriter(msgid, payload_bytes(msgid), SEEDS[msgid], table, ranges, _needs(contents.values()))
        )
    return constants, found


def _needs(contents: Iterable[Content]) -> int:
    """Return the groups of the quantities in the contents of a message, one bit each."""
    needs = 0
    for content in contents:
        for each in content if isinstance(content, tuple) else (content,):
            needs |= BITS[GROUP_OF[each]] if isinstance(each, str) else 0
    return needs


def _columns(msgid: int, names: str, content: Content, constants: list[float]) -> list[int]:
    """Return where the contents of some fields stand in the table of values. Constants are appended to `constants`.

    A single constant is the content of each element of one field.
    """
    if isinstance(content, float | int):
        content = (content,) * layout(msgid)[names].elements
    columns: list[int] = []
    for each in content if isinstance(content, tuple) else (content,):
        if isinstance(each, str):
            columns += range(COLUMNS[each], COLUMNS[each] + SIZES[each])
        else:
            columns.append(VALUES + len(constants))
            constants.append(each)
    return columns


def _fields_of(msgid: int, names: Sequence[str], columns: Sequence[int]) -> list[tuple[int, int, int]]:
    """Return the column in the table of values, and the place in the message, of each number in some fields.

    Each result is (column in the table of values, index of the number type in `KINDS`, byte offset divided by the type's size).

    A field of 64 bits whose offset is not a multiple of 8 needs two values: its lower and its upper 32 bits.

    columns: positions of the values in the table of values.
    Raises ValueError if the fields have another number of elements.
    """
    places: list[tuple[int, int]] = []
    for name in names:
        code, offset, count = layout(msgid)[name]
        if code == "Q" and offset % 8:
            code, count = "I", 2 * count
        place, rest = divmod(offset, struct.calcsize(f"<{code}"))
        if rest:
            raise ValueError(
                f"MAVLink message {msgid}: the offset of field {name} is not a multiple of its size"
            )
        places += [(KINDS.index(code), place + k) for k in range(count)]
    if len(places) != len(columns):
        raise ValueError(
            f"MAVLink message {msgid}: the fields {names} contain {len(places)} numbers, expected {len(columns)}"
        )
    return [(column, *place) for column, place in zip(columns, places, strict=True)]


def _ranges() -> Array:
    """Return the smallest and largest value of each number type in `KINDS` (9, 2).

    The types of 64 bits have the range of integers that a float represents exactly.
    """
    found = []
    for code in KINDS:
        bits = 8 * struct.calcsize(f"<{code}")
        low, high = (
            (0.0, 2.0**bits - 1.0) if code.isupper() else (-(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1.0)
        )
        found.append((max(low, -_EXACT), min(high, _EXACT)))
    return np.array(found)
