"""Telemetry messages that built-in autopilots send often: which quantity each field contains.

The kernel `telemetry_packing` computes the quantities and packs the frames. pymavlink's dialect defines the layouts.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.control.controllers import Cascade
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.flight_modes import MANUAL_MODES, Mode
from arena.autopilot.mavlink.telemetry_state import boot_ms
from arena.autopilot.vehicle import Vehicle
from arena.geometry import EARTH_M
from arena.kernels.arrays import array, flags, integers, view
from arena.kernels.payload_writer import KINDS, PayloadWriter
from arena.kernels.telemetry_packing import (
    COLUMNS,
    PLACE,
    SIZES,
    STATUS,
    VALUES,
    TelemetryPacking,
)
from arena.wire.mavlink_frame import SEEDS
from arena.wire.mavlink_layout import layout, payload_bytes
from arena.wire.px4_messages import ESC_INFO, ESC_STATUS

Array = NDArray[np.float64]
_NAN = float("nan")
_EXACT = 2.0**53  # integers up to this size are exact in a float

_UNKNOWN_TEMPERATURE = 32767
_BOOT = {"time_boot_ms": "time_ms"}
_TIME = {"time_usec": "time_us"}
_RATES = "rollspeed pitchspeed yawspeed"
FREQUENT: dict[int, dict[str, str | float]] = {
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
"""Message id -> names of fields -> the quantity that these fields contain, or a constant. All other fields are 0."""


class TelemetryPacker:
    """Packs the frequent telemetry messages of V vehicles with at most R rotors each.

    Use `begin` once per step, before `pack`.

    est, sp, cascade: estimator, setpoints and controllers of the vehicles
    thrust, motors: collective thrust (V,) and motor commands (V, R) 0..1
    law: the compiled packing
    """

    def __init__(self, est: Estimator, sp: Setpoints, cascade: Cascade, thrust: Array, motors: Array) -> None:
        self.law = packing = TelemetryPacking(view(thrust), view(motors), *_tables(), EARTH_M)
        inputs, place = array(packing.inputs), len(STATUS) + len(PLACE)
        self._status, self._place, self._lost = np.split(inputs, [len(STATUS), place], axis=1)
        self._xy_valid, self._escs = est.xy_valid, array(packing.escs)
        self._baro_alt = array(packing.baro_alt)
        self._mag_b = array(packing.mag_b)
        self._battery_v, self._battery_a = array(packing.battery_v), array(packing.battery_a)
        self._battery = array(packing.battery)
        packing.read_estimates_from(
            view(est.sensed_accel_b),
            view(est.sensed_gyro_b),
            view(est.p_n),
            view(est.v_n),
            view(est.q_nb),
            view(est.r_nb),
            view(est.omega_b),
            view(est.cov),
            integers(est.reset_counter),
            flags(est.xy_valid(0.0)),
        )
        position = cascade.position
        used = (sp.p_n, sp.yaw, sp.yaw_rate, position.v_sp_n, position.a_sp_n, cascade.q_sp, cascade.omega_sp)
        packing.read_setpoints_from(integers(sp.level), *(view(each) for each in used))

    def begin(self, now: float, sensors: Mapping[str, Array]) -> None:
        """Copy time and sensor values of this step to the compiled packer of telemetry.

        The compiled packer reads the other values from the arrays of the autopilots.

        now: time since boot [s]
        sensors: as for `Autopilots.step`, whose accelerations and body rates the estimator has stored
        """
        self._mag_b[...], self._baro_alt[...] = sensors["mag_b"], sensors["baro_alt_m"]
        self._battery_v[...], self._battery_a[...] = sensors["battery_v"], sensors["battery_current_a"]
        self._battery[...] = sensors["battery_remaining"]
        self._xy_valid(now)
        self.law.set_time(boot_ms(now), int(now * 1e6), int(now * 1e9))

    def pack(self, v: Vehicle, message_ids: list[int], seq: int) -> bytes:
        """Return the encoded frames of several messages of a vehicle.

        seq: sequence number of the first frame
        """
        return self.law.pack(v.row, message_ids, seq, v.system_id, 1)

    def frame_count(self, v: Vehicle, message_ids: list[int]) -> int:
        """Return how many frames `pack` returns for several messages of a vehicle."""
        return self.law.frame_count(v.row, message_ids)

    def set_status(self, v: Vehicle) -> None:
        """Copy mode, arming state and health of a vehicle to the compiled packer (attribute `law`)."""
        present, lost = _present(v, xy_valid=True), _present(v, xy_valid=False)
        self._status[v.row] = (
            v.mav_type,
            v.commander.mode.custom_mode,
            _base_mode(v),
            _status(v),
            v.landed_state,
            present,
            _health(v, present),
        )
        self._lost[v.row] = lost, _health(v, lost & ~mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION)

    def set_place(self, v: Vehicle) -> None:
        """Copy a vehicle's arming state, origin, home and number of rotors to the compiled packer (attribute `law`)."""
        self._escs[v.row] = v.rotors
        lat, lon, alt, _ = v.origin or (_NAN, _NAN, _NAN, 0.0)
        home_d = v.home_n[2] if v.home_n else _NAN
        self._place[v.row] = v.commander.armed, lat, lon, alt, v.heading, home_d


def _tables() -> tuple[list[float], list[PayloadWriter]]:
    """Return the constant field values of the frequent messages, and a compiled encoder for each message."""
    constants: list[float] = []
    writers, ranges = [], view(_ranges())
    for msgid, contents in FREQUENT.items():
        fields: list[tuple[int, int, int]] = []
        for names, content in contents.items():
            if isinstance(content, str):
                fields += _fields_of(msgid, names.split(), COLUMNS[content], SIZES[content])
            else:
                size = layout(msgid)[names].elements
                fields += _fields_of(msgid, [names], VALUES + len(constants), size)
                constants += [content] * size
        table, by_escs = integers(np.array(fields, np.int64)), msgid in (ESC_INFO, ESC_STATUS)
        writers.append(PayloadWriter(msgid, payload_bytes(msgid), SEEDS[msgid], table, ranges, by_escs))
    return constants, writers


def _fields_of(msgid: int, names: Sequence[str], column: int, size: int) -> list[tuple[int, int, int]]:
    """Return the column in the table of values, and the place in the message, of each number in some fields.

    Each result is (column in the table of values, index of the number type in `KINDS`, byte offset divided by the type's size).

    column: position of the first value in the table of values.  size: number of values.
    Raises ValueError if the number of elements in the fields is not `size`.
    """
    rows: list[tuple[int, int, int]] = []
    for name in names:
        code, offset, count = layout(msgid)[name]
        place, rest = divmod(offset, struct.calcsize(f"<{code}"))
        if rest:
            raise ValueError(
                f"MAVLink message {msgid}: the offset of field {name} is not a multiple of its size"
            )
        rows += [(column + len(rows) + k, KINDS.index(code), place + k) for k in range(count)]
    if len(rows) != size:
        raise ValueError(
            f"MAVLink message {msgid}: the fields {names} contain {len(rows)} numbers, expected {size}"
        )
    return rows


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


def _base_mode(v: Vehicle) -> int:
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
        mavlink.MAV_MODE_FLAG_SAFETY_ARMED if v.commander.armed else 0
    )
    mode = v.commander.mode
    if mode is not Mode.ACRO:
        base |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    if mode in MANUAL_MODES:
        base |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    elif mode is not Mode.OFFBOARD:
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


_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION
    | mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
    | mavlink.MAV_SYS_STATUS_AHRS
)


def _present(v: Vehicle, *, xy_valid: bool) -> int:
    """Return the sensors that a vehicle has, as MAV_SYS_STATUS_SENSOR bits.

    xy_valid: the horizontal position is valid
    """
    bits = (
        # SDKs interpret the GPS bit as "the global position is valid", whatever its source.
        (mavlink.MAV_SYS_STATUS_SENSOR_GPS, _has_origin(v) and xy_valid),
        (mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL, xy_valid),
        (mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, v.inputs.manual_control),
        (mavlink.MAV_SYS_STATUS_LOGGING, v.is_logged),
    )
    return int(_SENSORS | sum(bit for bit, has in bits if has))


def _health(v: Vehicle, working: int) -> int:
    """Return the working sensors and the arming checks as MAV_SYS_STATUS_SENSOR bits.

    As in PX4, logging is healthy whether a log is written or not.
    """
    ready = mavlink.MAV_SYS_STATUS_PREARM_CHECK if v.ready_to_arm else 0
    return int(working | mavlink.MAV_SYS_STATUS_LOGGING | ready)


def _is_aligned(v: Vehicle) -> bool:
    """Return whether the estimator is initialised.

    From then on the position is sent even if it is not valid, as in PX4.
    """
    return v.aligned


def _has_origin(v: Vehicle) -> bool:
    return v.origin is not None


HAS_CONTENT: dict[int, Callable[[Vehicle], bool]] = {
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _is_aligned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _has_origin,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _has_origin,
}
"""Message id -> function that returns whether a vehicle has content for the message. All other messages always have content."""
NEEDS_POSITION = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
    mavlink.MAVLINK_MSG_ID_ODOMETRY,
}
"""Ids of messages that are sent only while the horizontal position is valid."""
