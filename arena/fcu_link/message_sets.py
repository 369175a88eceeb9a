"""Ids of the MAVLink messages that the link process decodes, or routes in a special way. Pure data."""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

IMU = mavlink.MAVLINK_MSG_ID_HIGHRES_IMU
TIMESYNC = mavlink.MAVLINK_MSG_ID_TIMESYNC
ACTUATORS = mavlink.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS
SENSORS = (
    mavlink.MAVLINK_MSG_ID_HIL_SENSOR,
    mavlink.MAVLINK_MSG_ID_HIL_GPS,
    mavlink.MAVLINK_MSG_ID_HIL_OPTICAL_FLOW,
)
VISION_MESSAGES = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
        mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    }
)
DECODED = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        IMU,
        TIMESYNC,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    }
)
