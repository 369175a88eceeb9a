"""Builders of telemetry messages that are sent rarely, for ground stations and SDKs.

Each function builds the message of one vehicle. It returns None if the vehicle has no valid content for the message now.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.flight_modes import Mode
from arena.autopilot.mavlink import component_files
from arena.autopilot.mavlink.telemetry_state import TelemetryState
from arena.autopilot.vehicle import LANDED_STATE_ON_GROUND, Vehicle
from arena.constants import GRAVITY_M_S2
from arena.geometry import EARTH_M
from arena.kernels.global_coordinates import global_position
from arena.wire import px4_messages

_RC_TIMEOUT_S = 1.0
_RC_CENTRE_US, _RC_END_US, _NO_CHANNEL = 1500, 500, 65535
_RC_SHOWN = 8  # channels of the simulated radio
_RSSI_UNKNOWN = 255
_HAS_TARGET = {Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RTL, Mode.LAND}
_UINT16_MAX = 65535
_ALL_AXES = 0


def rc_channels(v: Vehicle, s: TelemetryState) -> Any:
    """Return RC_CHANNELS with the pulse widths of the RC channels [us]; None if no RC signal is received.

    The channels are roll, pitch, throttle, yaw, and four centred channels.
    """
    if s.now_s - v.manual_control.radio > _RC_TIMEOUT_S:
        return None
    sticks = v.manual_control.sticks_of("radio")
    moved = (sticks.roll, sticks.pitch, sticks.throttle, sticks.yaw)
    given = [round(_RC_CENTRE_US + _RC_END_US * x) for x in moved] + [_RC_CENTRE_US] * (_RC_SHOWN - 4)
    channels = given + [_NO_CHANNEL] * (18 - _RC_SHOWN)
    return mavlink.MAVLink_rc_channels_message(s.ms, _RC_SHOWN, *channels, _RSSI_UNKNOWN)


def has_radio(v: Vehicle) -> bool:
    """Return whether radio control (RC) was received at least once since boot."""
    return v.manual_control.radio > -math.inf


def has_target(v: Vehicle) -> bool:
    """Return whether the autopilot flies by itself to a position, in one of its AUTO modes."""
    return v.commander.armed and v.origin is not None and v.commander.mode in _HAS_TARGET


def position_target_global_int(v: Vehicle, s: TelemetryState) -> Any:
    """Return POSITION_TARGET_GLOBAL_INT: the position to which an AUTO mode flies.

    Return None in the other modes, and without an origin or a target.
    """
    target = s.setpoint_n[v.row].tolist()
    if not has_target(v) or v.origin is None or not all(math.isfinite(x) for x in target):
        return None
    lat0, lon0, alt0, heading = v.origin
    lat, lon = global_position(target[0], target[1], heading, lat0, lon0, EARTH_M)
    velocity = [x if math.isfinite(x) else 0.0 for x in s.setpoint_v_n[v.row].tolist()]
    yaw = float(s.setpoint_yaw[v.row])
    return mavlink.MAVLink_position_target_global_int_message(
        s.ms,
        mavlink.MAV_FRAME_GLOBAL_INT,
        _ALL_AXES,
        int(lat),
        int(lon),
        alt0 - target[2],
        *velocity,
        0.0,
        0.0,
        0.0,
        yaw + heading if math.isfinite(yaw) else 0.0,
        0.0,
    )


def has_leg(v: Vehicle) -> bool:
    """Return whether the vehicle now flies to a point of a mission, of RTL or of a reposition command."""
    return v.leg_target_n is not None and v.origin is not None


def nav_controller_output(v: Vehicle, s: TelemetryState) -> Any:
    """Return NAV_CONTROLLER_OUTPUT: distance and bearing of the point to which the autopilot flies.

    The autopilot flies to a point in a mission, in RTL and to a reposition target. Otherwise return None.
    """
    if v.leg_target_n is None or v.origin is None:
        return None
    i = v.row
    north, east, down = (to - at for to, at in zip(v.leg_target_n, s.est.p_n[i].tolist(), strict=True))
    bearing = math.degrees(math.atan2(east, north) + v.origin.heading)
    bearing = (bearing + 180.0) % 360.0 - 180.0
    r = s.est.r_nb[i]
    return mavlink.MAVLink_nav_controller_output_message(
        math.degrees(math.atan2(r[2, 1], r[2, 2])),
        math.degrees(-math.asin(max(-1.0, min(1.0, float(r[2, 0]))))),
        round(bearing),
        round(bearing),
        min(round(math.hypot(north, east)), _UINT16_MAX),
        -down,
        0.0,
        0.0,
    )


def actuator_output_status(v: Vehicle, s: TelemetryState) -> Any:
    """Return ACTUATOR_OUTPUT_STATUS with the pulse width of each motor [us]; 900 while disarmed."""
    motors = s.motors[v.row, : v.rotors].tolist()
    pulses = [1000.0 + 1000.0 * m if v.commander.armed else 900.0 for m in motors]
    return mavlink.MAVLink_actuator_output_status_message(
        s.us, len(pulses), pulses + [0.0] * (32 - len(pulses))
    )


def scaled_imu(v: Vehicle, s: TelemetryState) -> Any:
    i = v.row
    accel = [_int16(x * 1e3 / GRAVITY_M_S2) for x in s.accel_b[i].tolist()]
    rates = [_int16(x * 1e3) for x in s.gyro_b[i].tolist()]
    field = [_int16(x * 1e3) for x in s.mag_b[i].tolist()]
    return mavlink.MAVLink_scaled_imu_message(s.ms, *accel, *rates, *field, 2500)


def has_orbit(v: Vehicle) -> bool:
    """Return whether the vehicle flies on a circle (MAV_CMD_DO_ORBIT)."""
    return v.orbit is not None and v.origin is not None


def orbit_execution_status(v: Vehicle, s: TelemetryState) -> Any:
    """Return ORBIT_EXECUTION_STATUS: the circle on which the vehicle flies.

    Return None if the vehicle does not fly on a circle, or if no origin is set.
    """
    if v.orbit is None or v.origin is None:
        return None
    lat0, lon0, alt0, heading = v.origin
    north, east, down = v.orbit.centre
    lat, lon = global_position(north, east, heading, lat0, lon0, EARTH_M)
    radius = math.copysign(v.orbit.radius, v.orbit.velocity)
    frame = mavlink.MAV_FRAME_GLOBAL
    return mavlink.MAVLink_orbit_execution_status_message(
        s.us, radius, frame, int(lat), int(lon), alt0 - down
    )


def _int16(value: float) -> int:
    return int(min(max(value, -32768.0), 32767.0)) if math.isfinite(value) else 0


def flight_information(v: Vehicle, s: TelemetryState) -> Any:
    """Return FLIGHT_INFORMATION with the times of arming and take-off since boot.

    A time is 0 while the vehicle is disarmed, or on the ground. PX4 v1.16 counts from the boot, too.
    """
    armed, up = v.commander.armed, v.landed_state != LANDED_STATE_ON_GROUND
    return mavlink.MAVLink_flight_information_message(
        s.ms,
        int(v.commander.armed_since * 1e6) if armed else 0,
        int(v.took_off_at * 1e6) if up else 0,
        v.flights,
    )


def protocol_version(v: Vehicle, s: TelemetryState) -> Any:
    return px4_messages.protocol_version()


def component_metadata(v: Vehicle, s: TelemetryState) -> Any:
    return px4_messages.component_metadata(s.ms, *component_files.GENERAL)


def component_information(v: Vehicle, s: TelemetryState) -> Any:
    return px4_messages.component_information(s.ms, *component_files.GENERAL)


def available_modes_monitor(v: Vehicle, s: TelemetryState) -> Any:
    return px4_messages.available_modes_monitor()


BUILDERS = {
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: rc_channels,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: position_target_global_int,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: nav_controller_output,
    mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS: actuator_output_status,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU: scaled_imu,
    mavlink.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: orbit_execution_status,
    mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION: flight_information,
    px4_messages.PROTOCOL_VERSION: protocol_version,
    px4_messages.COMPONENT_METADATA: component_metadata,
    px4_messages.COMPONENT_INFORMATION: component_information,
    px4_messages.AVAILABLE_MODES_MONITOR: available_modes_monitor,
}
HAS_CONTENT: dict[int, Callable[[Vehicle], bool]] = {
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: has_radio,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: has_target,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: has_leg,
    mavlink.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: has_orbit,
}
"""Message id -> function that returns False while a vehicle cannot have content for the message. Then the stream costs no time."""
