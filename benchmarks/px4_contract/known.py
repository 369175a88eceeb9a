"""Accepted differences: pattern of `case: observation` -> reason.

A difference without a reason makes the comparison fail.
"""

from __future__ import annotations

_SAFER = "safer: OFFBOARD is not re-entered automatically; PX4 returns to it with the next setpoint or pose"
_AFTER = "safer: the mode after landing and disarming is HOLD; PX4 returns to the mode requested last"
_THRUST = "safer: an attitude without a valid thrust is refused; PX4 v1.16 flies it with thrust 0 and falls"
_RANGE = "safer: a value that is not finite or out of range is refused, the reply holds the old one; PX4 v1.16 accepts any value"
_STREAMS = "not available: remote id, link statistics, time to target"
_SILENT = "only HEARTBEAT is sent until a ground station has sent a message; PX4 sends all streams to its partner from the start"
_FIX = "a satellite fix is reported, because SDKs wait for one before they fly to a global position; PX4 without GPS reports none"
_ALTITUDE = "the origin has the altitude of the YAML; PX4 gets an origin at altitude 0, because its estimator would jump"
_CALIBRATION = "refused, with a text in PX4's form: the simulated sensors need no calibration"
_OWN_FILE = "PX4 announces the checksum of another form of its file"
_ORBIT = "flown in AUTO.LOITER, and accepted only inside geofence and limits; PX4 has a mode of its own"
_OTHERS = "safer: only requests for this vehicle are answered; PX4 answers requests for every vehicle"
_BY_COMMAND = (
    "a mission item can also be selected by a command; PX4 supports only the message MISSION_SET_CURRENT"
)
_NO_OUTPUT = "acknowledged as unsupported; PX4 sends no acknowledgement"
_SENSORS = "other flags: vision, and the sensors for which SDKs wait (compass, GPS); only what it has is reported healthy"
_NO_PILOT = "safer: without stick positions it lands; PX4 enters a manual mode that nobody flies"
_NO_NUMBERS = "safer: attitude, rates or thrust with NaN are refused; PX4 v1.16 enters OFFBOARD with them"
_LANDS_SOONER = "AUTO.LAND descends at once; PX4's jerk-limited trajectory needs half a second to start"
_SETPOINT_SENT = "the setpoint in use is sent (none in attitude and rate control, the stopping point while landing); PX4 repeats the last"
_ARGUMENTS = "a meaningless argument is denied; PX4 accepts it and does nothing, or something else"
_TWICE = (
    "PX4 v1.16 acknowledges MAV_CMD_DO_SET_MODE twice, accepted first; here only the final result is sent"
)
_TERMINATES = "flight termination has its own mode and state in HEARTBEAT; PX4's HEARTBEAT does not change"
_TERMINATED = "safer: a terminated vehicle disarms when it has landed; PX4 was still armed 18 s later"
_NO_REBOOT = "PX4 SITL cannot reboot and denies it; here the estimator restarts"
_INTERVAL = "an interval shorter than a step becomes one step; PX4 stops the stream"
_JUMP = "safer: a pose that jumps is rejected, then reported lost; PX4 follows it"

_NO_SUCH_MODE = (
    "precision landing, follow-me, external and unknown modes are not supported: refused with a text. PX4 enters them, or "
    "acknowledges them without effect"
)
_NOT_THERE = "acknowledged as unsupported; PX4 supports it, does not reply, or accepts it without effect"
_STAYS = "refused with a text; PX4 v1.16 first acknowledges it, then refuses it without a text"
_BLIND = "safer: the heading comes from poses only, and arming needs a heading; PX4 arms without a heading for attitude and rate control"
_MORE_MESSAGES = "not available; the values exist in other messages"
_PLACE = "arming in HOLD needs no global position; the arena's pose forwarder sends an origin"
_CLIMB = "AUTO.TAKEOFF ends at its height; PX4's ends within NAV_MC_ALT_RAD below it and climbs on in HOLD"

KNOWN: dict[str, str] = {
    "offboard lost and found: with setpoints again": _SAFER,
    "poses lost and found: *": _SAFER,
    "*: mode after disarming": _AFTER,
    "by hand, change of modes: * without sticks: ack": _STAYS,
    "battery empties, COM_LOW_BAT_ACT [23]: modes": _AFTER,
    "battery empties, COM_LOW_BAT_ACT [23]: AUTO.LOITER at": _AFTER,
    "offboard entered: infinite: *": _NO_NUMBERS,
    "offboard entered: attitude nan: *": _NO_NUMBERS,
    "offboard entered: attitude of zero length: *": _NO_NUMBERS,
    "offboard entered: attitude, thrust nan: *": _NO_NUMBERS,
    "offboard entered: attitude, thrust ignored: *": _THRUST,
    "offboard entered: rates nan: *": _NO_NUMBERS,
    "offboard entered: *: ack": _STAYS,
    "setpoints in the air, attitude: attitude, thrust ignored*": _THRUST,
    "parameter write: *out of*": _RANGE,
    "parameter write: float below*": _RANGE,
    "parameter write: negative integer*": _RANGE,
    "parameter write: nan*": _RANGE,
    "parameter write: infinite*": _RANGE,
    "parameter write: huge*": _RANGE,
    "ground station link, rates*: id [38]*": _STREAMS,
    "ground station link, rates*: OPEN_DRONE_ID*": _STREAMS,
    "ground station link, rates*: GPS_RAW_INT": _FIX,
    "ground station link, silent: streams": _SILENT,
    "rates, disarmed: id 8 *": _STREAMS,
    "rates, disarmed: id 380 *": _STREAMS,
    "rates, disarmed: OPEN_DRONE_ID*": _STREAMS,
    "*: SYS_STATUS present": _SENSORS,
    "*: SYS_STATUS enabled": _SENSORS,
    "*: SYS_STATUS health": _SENSORS,
    "offboard lost, action 0 *": _NO_PILOT,
    "offboard lost, action 1 *": _NO_PILOT,
    "offboard lost, action 2 *": _NO_PILOT,
    "arm in each mode: 4.6: ready to arm, reported": "the prearm bit considers whether the mode allows arming; PX4's does not",
    "commands *: arm 2: *": _ARGUMENTS,
    "commands *: arm nan: *": _ARGUMENTS,
    "commands *: arm 0.5: *": _ARGUMENTS,
    "commands *: set mode*": _TWICE,
    "message interval: *as fast as it goes*": _INTERVAL,
    "message interval: nan*": _ARGUMENTS,
    "message interval: infinite*": _ARGUMENTS,
    "message interval: ATTITUDE after infinite*": _ARGUMENTS,
    "request message: nan: ack": _ARGUMENTS,
    "request message: infinite: ack": _ARGUMENTS,
    "reboot: ack": _NO_REBOOT,
    "hit and turned over: *": _TERMINATES,
    "data link lost, NAV_DLL_ACT 5: armed in the end": _TERMINATED,
    "data link lost, NAV_DLL_ACT 5: disarmed after": _TERMINATED,
    "poses jump: *": _JUMP,
    "parameter list: count": "it has only the parameters that it uses",
    "modes *: [1-357].0: *": _STAYS,
    "modes *: [89].0: *": _NO_SUCH_MODE,
    "modes *: 1[01].0: *": _NO_SUCH_MODE,
    "modes *: 3.[12]: *": _NO_SUCH_MODE,
    "modes *: 4.0: *": _NO_SUCH_MODE,
    "modes *: 4.[89]: *": _NO_SUCH_MODE,
    "modes *: 4.1[0-9]: *": _NO_SUCH_MODE,
    "modes *: 4.99: ack": _NO_SUCH_MODE,
    "modes *: 4.[147]: *": _STAYS,
    "arm without poses: OFFBOARD by attitude: *": _BLIND,
    "arm without poses: OFFBOARD by rates: *": _BLIND,
    "commands *: orbit: *": _ORBIT,
    "commands *: calibrate *: ack": _CALIBRATION,
    "commands *: calibrate *: complains": _CALIBRATION,
    "commands *: set mission current: ack": _BY_COMMAND,
    "mission item selected by a command: *": _BY_COMMAND,
    "calibration of a sensor: ack": _CALIBRATION,
    "files: checksum *": _OWN_FILE,
    "logs: last_log_num": "the number of the last log, as the message defines; PX4 v1.16 sends the number of logs",
    "logs: for another vehicle": _OTHERS,
    "events: for another vehicle": _OTHERS,
    "events in the air: mission without items: *": _STAYS,
    "motor test: output *": _NO_OUTPUT,
    "*: GPS_RAW_INT *": _FIX,
    "request message: GPS_RAW_INT: *": _FIX,
    "request message: id 411: *": "sent on request, too; PX4 sends it only as a stream",
    "rates, *: SYSTEM_TIME on panic": "every link has it; the script's PX4 sends it on two links",
    "*: * altitude": _ALTITUDE,
    "*: ALTITUDE amsl": _ALTITUDE,
    "*: GLOBAL_POSITION_INT alt": _ALTITUDE,
    "request message: STORAGE_INFORMATION: *": _MORE_MESSAGES,
    "commands *: region of interest: ack": _NOT_THERE,
    "commands *: no region of interest: ack": _NOT_THERE,
    "commands *: *actuator: ack": _NOT_THERE,
    "commands *: sensor offsets: ack": _NOT_THERE,
    "commands *: storage nan: ack": _NOT_THERE,
    "commands *: *gimbal*: ack": _NOT_THERE,
    "commands *: *camera*: ack": _NOT_THERE,
    "commands *: request storage information: ack": _NOT_THERE,
    "commands *: logging st*: ack": _NOT_THERE,
    "commands *: control high latency: *": _NOT_THERE,
    "commands *: set standard mode: ack": _NOT_THERE,
    "commands *: land local: *": _NOT_THERE,
    "commands *: vtol transition: ack": _NOT_THERE,
    "commands *: external position estimate: ack": _NOT_THERE,
    "commands *: payload deploy: ack": _NOT_THERE,
    "commands *: autotune: ack": _NOT_THERE,
    "commands *: preflight uavcan: ack": _NOT_THERE,
    "commands *: set sys status: ack": _NOT_THERE,
    "commands *: command 0: ack": _NOT_THERE,
    "commands *: figure eight: *": _NOT_THERE,
    "commands *: * parameters: ack": "nothing is stored: at the next start the parameters are those of the YAML",
    "other setters: SET_GPS_GLOBAL_ORIGIN: moved": "safer: an armed vehicle keeps its origin; PX4 takes the new one and flies away",
    "commands *: inject failure: ack": "only supported failures are injected, if SYS_FAILURE_EN is set; PX4 accepts unit 0",
    "commands *: set home at no place: ack": _ARGUMENTS,
    "request message: HIL_ACTUATOR_CONTROLS: *": _MORE_MESSAGES,
    "rates and contents in the air: OPEN_DRONE_ID*": _STREAMS,
    "rates and contents in the air: id [23489]*": _STREAMS,
    "rates and contents in the air: after landing": _AFTER,
    "*: SYS_STATUS voltage": "the battery is the profile's, with 3 cells; PX4 simulates one with 4",
    "*: HIGHRES_IMU abs_pressure": "in hPa, as the message defines; PX4 v1.16 sends Pa",
    "*: POSITION_TARGET_LOCAL_NED frame and mask": "axes without a setpoint are masked; PX4 sends zeros or its feed-forward values",
    "*: ESTIMATOR_STATUS flags": "another filter: it reports a predicted position; PX4 reports a constant position",
    "parameter list: MIS_*": "PX4 lists a parameter only once a module has asked for it",
    "battery empties*: ended by itself": "another battery model; PX4's simulated battery never becomes empty",
    "setpoints in the air, *: target sent": _SETPOINT_SENT,
    "setpoints in the air, frames: *: down": _LANDS_SOONER,
    "setpoints in the air, attitude: attitude nan: *": _NO_NUMBERS,
    "setpoints in the air, attitude: attitude of zero length: *": _NO_NUMBERS,
    "setpoints in the air, attitude: rates nan: *": _NO_NUMBERS,
    "setpoints in the air, attitude: thrust nan: *": _NO_NUMBERS,
    "setpoints in the air, attitude: thrust [mb]o*: down": "thrust is open loop: the result depends on battery and initial speed",
    "setpoints in the air, attitude: thrust negative: *": "safer: refused; PX4 v1.16 flies its absolute value",
    "gps origin: before: may arm": _PLACE,
    "take off and land: height at the change": _CLIMB,
    "take off and land: take-off lasts": _CLIMB,
}
