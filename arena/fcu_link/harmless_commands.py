"""Commands that cannot arm a vehicle or spin a motor, with the reason for each. Pure data.

While a preflight check of a disarmed vehicle fails, the link passes on these commands, and those whose effect
`arena.authority.parse_request` knows. Every other command is refused. The effects are those in the source code of
PX4 v1.16 (Commander.cpp, mavlink_receiver.cpp).
"""

from __future__ import annotations

from collections.abc import Mapping

from pymavlink.dialects.v20 import common as mavlink

_READS = "only requests a message"
_SETTING = "changes a setting or a reference position"
_CAMERA = "controls a camera or a gimbal"
_ROI = "turns a gimbal, or the nose of a vehicle that flies"
_FLIGHT = "changes a flight that has begun"

HARMLESS: Mapping[int, str] = {
    mavlink.MAV_CMD_REQUEST_MESSAGE: _READS,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: "sets the rate of a message",
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: _READS,
    mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: _READS,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _READS,
    mavlink.MAV_CMD_REQUEST_FLIGHT_INFORMATION: _READS,
    mavlink.MAV_CMD_REQUEST_STORAGE_INFORMATION: _READS,
    mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION: _READS,
    mavlink.MAV_CMD_REQUEST_CAMERA_SETTINGS: _READS,
    mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: _READS,
    mavlink.MAV_CMD_REQUEST_CAMERA_IMAGE_CAPTURE: _READS,
    mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION: _READS,
    mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_STATUS: _READS,
    mavlink.MAV_CMD_GET_HOME_POSITION: _READS,
    mavlink.MAV_CMD_UAVCAN_GET_NODE_INFO: _READS,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: "runs PX4's own checks and reports them",
    mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: "calibrates a sensor; the calibration of ESCs (param7) is refused",
    mavlink.MAV_CMD_PREFLIGHT_SET_SENSOR_OFFSETS: _SETTING,
    mavlink.MAV_CMD_PREFLIGHT_UAVCAN: "with param1 = 0 ends a configuration; every other value is refused",
    mavlink.MAV_CMD_PREFLIGHT_STORAGE: "saves, loads or resets parameters; parameters are compared afterwards",
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: "PX4 starts disarmed, and the checks start again",
    mavlink.MAV_CMD_DO_SET_HOME: _SETTING,
    mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE: _SETTING,
    mavlink.MAV_CMD_FIXED_MAG_CAL_YAW: "calibrates the magnetometer",
    mavlink.MAV_CMD_DO_FENCE_ENABLE: _SETTING,
    mavlink.MAV_CMD_CONTROL_HIGH_LATENCY: "changes the rate of a telemetry link",
    mavlink.MAV_CMD_START_RX_PAIR: "binds an RC receiver",
    mavlink.MAV_CMD_LOGGING_START: "starts a log",
    mavlink.MAV_CMD_LOGGING_STOP: "ends a log",
    mavlink.MAV_CMD_STORAGE_FORMAT: "formats the SD card; PX4 refuses it while armed",
    mavlink.MAV_CMD_DO_PARACHUTE: "releases a parachute, which must be possible at any time",
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _FLIGHT,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: _FLIGHT,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: "selects an item of the mission; MISSION_START is refused",
    mavlink.MAV_CMD_DO_SET_ROI: _ROI,
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION: _ROI,
    mavlink.MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET: _ROI,
    mavlink.MAV_CMD_DO_SET_ROI_NONE: _ROI,
    mavlink.MAV_CMD_DO_MOUNT_CONFIGURE: _CAMERA,
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: _CAMERA,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: _CAMERA,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: _CAMERA,
    mavlink.MAV_CMD_DO_DIGICAM_CONTROL: _CAMERA,
    mavlink.MAV_CMD_SET_CAMERA_MODE: _CAMERA,
    mavlink.MAV_CMD_SET_CAMERA_ZOOM: _CAMERA,
    mavlink.MAV_CMD_SET_CAMERA_FOCUS: _CAMERA,
    mavlink.MAV_CMD_IMAGE_START_CAPTURE: _CAMERA,
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE: _CAMERA,
    mavlink.MAV_CMD_VIDEO_START_CAPTURE: _CAMERA,
    mavlink.MAV_CMD_VIDEO_STOP_CAPTURE: _CAMERA,
    mavlink.MAV_CMD_VIDEO_START_STREAMING: _CAMERA,
    mavlink.MAV_CMD_VIDEO_STOP_STREAMING: _CAMERA,
}
"""MAV_CMD -> why it cannot arm the vehicle or spin a motor."""
