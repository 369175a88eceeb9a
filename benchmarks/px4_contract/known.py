"""The differences that stay: pattern of `case: observation` -> why. A difference that none explains fails."""

from __future__ import annotations

_SAFER = "safer: nothing comes back into OFFBOARD by itself (the pilot wins); PX4 returns to it with the next setpoint or pose"
_AFTER = (
    "safer: after landing and disarming it stands in HOLD; PX4 goes back to the mode that was asked for last"
)
_THRUST = "safer: an attitude without a thrust, or with one that is no number, is refused; PX4 v1.16 flies it with thrust 0 and falls"
_RANGE = "safer: a value that is not finite or out of its documented range is answered with the old one; PX4 v1.16 takes anything"
_STREAMS = (
    "nothing there that it could tell: ESCs, vibration, remote id, events, link statistics, time to target"
)
_SENSORS = "the sensors that are there differ: no compass, logger and stick receiver, but vision"
_STICKS = "no sticks: modes flown by hand do not exist; the failsafes that ask for them land"
_NO_NUMBERS = (
    "safer: an attitude, rates or thrust that are no numbers are refused; PX4 v1.16 enters OFFBOARD with them"
)
_LANDS_SOONER = "AUTO.LAND sets out at once; PX4's jerk-limited trajectory takes half a second to"
_TOLD = "what flies is told: none in attitude and rates, a point to brake to while landing; PX4 repeats what was told before"
_ARGUMENTS = (
    "an argument that makes no sense is denied; PX4 acknowledges it and does nothing, or something else"
)
_TWICE = (
    "PX4 v1.16 acknowledges MAV_CMD_DO_SET_MODE twice, accepted first; only the answer that counts is sent"
)
_TERMINATES = "flight termination is told as a mode and a state of its own; PX4's heartbeat goes on as it was"
_NO_REBOOT = "a SITL of PX4 cannot reboot and denies it; here the estimator begins anew"
_INTERVAL = "an interval shorter than a step is the step; PX4 stops the stream"
_CLOCK = "no calendar: the pure core has simulation time alone"
_JUMP = "safer: a pose that jumps is rejected, then declared lost; PX4 follows it"

_NO_SUCH_MODE = (
    "modes flown by hand, precision landing, following and external modes are not there: refused with a text. PX4 takes them, or "
    "acknowledges them first and refuses then, in silence"
)
_NOT_THERE = "not there and acknowledged as unsupported; PX4 has it, says nothing at all, or accepts what it then does not do"
_STAYS = "refused with a text; PX4 v1.16 acknowledges it first, refuses then, and says nothing"
_BLIND = "safer: its heading comes from the poses alone, and nothing arms without one; PX4 does, by attitude and rates"
_MORE_MESSAGES = "nothing there that it could tell: what it has comes in other messages"
_PROTOCOL = "PROTOCOL_VERSION is deprecated and not in the dialect: AUTOPILOT_VERSION says the same"
_FTP = "no files: FTP is not there"
_PLACE = "needs no place on the globe to arm in HOLD; the arena's forwarder tells one"
_CLIMB = "AUTO.TAKEOFF ends at its height; PX4's ends within NAV_MC_ALT_RAD below it and climbs on in HOLD"

KNOWN: dict[str, str] = {
    "offboard lost and found: with setpoints again": _SAFER,
    "poses lost and found: *": _SAFER,
    "*: mode after disarming": _AFTER,
    "battery empties, COM_LOW_BAT_ACT [23]: modes": _AFTER,
    "battery empties*: warnings at about": "a warning is said once; PX4 repeats it when it acts",
    "battery empties*: in the end": "the battery it has drained at its own pace: it is empty before the landing disarms",
    "offboard entered: infinite: *": _NO_NUMBERS,
    "offboard entered: attitude*: *": _NO_NUMBERS,
    "offboard entered: rates nan: *": _NO_NUMBERS,
    "offboard entered: *: ack": _STAYS,
    "setpoints in the air, attitude: attitude, thrust ignored*": _THRUST,
    "parameter write: *out of*": _RANGE,
    "parameter write: float below*": _RANGE,
    "parameter write: negative integer*": _RANGE,
    "parameter write: nan*": _RANGE,
    "parameter write: infinite*": _RANGE,
    "parameter write: huge*": _RANGE,
    "rates, disarmed: id 8 *": _STREAMS,
    "rates, disarmed: id 29*": _STREAMS,
    "rates, disarmed: id 380 *": _STREAMS,
    "rates, disarmed: id 411 *": _STREAMS,
    "rates, disarmed: OPEN_DRONE_ID*": _STREAMS,
    "rates, disarmed: VIBRATION *": _STREAMS,
    "rates, *: SYSTEM_TIME on *": _STREAMS,
    "*: SYS_STATUS present": _SENSORS,
    "*: SYS_STATUS enabled": _SENSORS,
    "*: SYS_STATUS health": _SENSORS,
    "*: SYSTEM_TIME knows the date": _CLOCK,
    "offboard lost, action 0 *": _STICKS,
    "offboard lost, action 1 *": _STICKS,
    "offboard lost, action 2 *": _STICKS,
    "arm in each mode: 2.0: *": _STICKS,
    "arm in each mode: 3.0: *": _STICKS,
    "arm in each mode: 7.0: *": _STICKS,
    "arm in each mode: 4.6: ready to arm, it says": "the ready bit counts the mode, which does not arm; PX4's leaves it out",
    "arm and disarm: arm: severities*": "no log files: PX4 tells when it opens one",
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
    "poses jump: *": _JUMP,
    "parameter write: hash: read after": "another set of parameters has another hash",
    "parameter list: count": "only the parameters that mean something to it are there",
    "capabilities: capabilities*": _FTP,
    "capabilities: protocol version*": _PROTOCOL,
    "request message: id 300*": _PROTOCOL,
    "modes *: [1-357-9].0: *": _NO_SUCH_MODE,
    "modes *: 1[01].0: *": _NO_SUCH_MODE,
    "modes *: 3.[12]: *": _NO_SUCH_MODE,
    "modes *: 4.0: *": _NO_SUCH_MODE,
    "modes *: 4.[89]: *": _NO_SUCH_MODE,
    "modes *: 4.1[0-9]: *": _NO_SUCH_MODE,
    "modes *: 4.99: ack": _NO_SUCH_MODE,
    "modes *: 4.[147]: *": _STAYS,
    "modes on the ground: SET_MODE 3.0: *": _STICKS,
    "arm without poses: mode [1-357].0: *": _STICKS,
    "arm without poses: OFFBOARD by attitude: *": _BLIND,
    "arm without poses: OFFBOARD by rates: *": _BLIND,
    "commands *: calibrate *: ack": _NOT_THERE,
    "commands *: actuator test: ack": _NOT_THERE,
    "commands *: orbit: *": _NOT_THERE,
    "commands *: region of interest: ack": _NOT_THERE,
    "commands *: no region of interest: ack": _NOT_THERE,
    "commands *: *actuator: ack": _NOT_THERE,
    "commands *: sensor offsets: ack": _NOT_THERE,
    "commands *: storage nan: ack": _NOT_THERE,
    "commands *: *gimbal*: ack": _NOT_THERE,
    "commands *: *camera*: ack": _NOT_THERE,
    "commands *: request storage information: ack": _NOT_THERE,
    "commands *: request flight information: ack": _NOT_THERE,
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
    "commands *: * parameters: ack": "nothing is stored: parameters are the YAML's again at the next start",
    "other setters: SET_GPS_GLOBAL_ORIGIN: moved": "safer: an armed vehicle keeps its origin; PX4 flies off by the difference",
    "commands *: inject failure: ack": "only what can fail is injected, where SYS_FAILURE_EN is set; PX4 accepts unit 0",
    "commands *: set home at no place: ack": _ARGUMENTS,
    "request message: SCALED_IMU: *": _MORE_MESSAGES,
    "request message: HIL_ACTUATOR_CONTROLS: *": _MORE_MESSAGES,
    "request message: VIBRATION: *": _MORE_MESSAGES,
    "request message: *_INFORMATION: *": _MORE_MESSAGES,
    "request message: id 395: *": _MORE_MESSAGES,
    "rates and contents in the air: OPEN_DRONE_ID*": _STREAMS,
    "rates and contents in the air: VIBRATION *": _STREAMS,
    "rates and contents in the air: id [23489]*": _STREAMS,
    "rates and contents in the air: after landing": _AFTER,
    "*: SYS_STATUS voltage": "the battery is the profile's, here of three cells; PX4's simulation has one of four of its own",
    "*: HIGHRES_IMU abs_pressure": "in hPa, as the message says; PX4 v1.16 fills in pascals",
    "*: POSITION_TARGET_LOCAL_NED frame and mask": "what is not asked for is masked; PX4 tells zeros and its feed-forward",
    "*: ESTIMATOR_STATUS flags": "another filter: it predicts where PX4's flags a constant position",
    "parameter list: MIS_*": "PX4 lists a parameter only once a module has asked for it",
    "battery empties*: ended by itself": "the battery it has drained at its own pace; PX4's simulated one never quite empties",
    "setpoints in the air, *: target told": _TOLD,
    "setpoints in the air, frames: *: down": _LANDS_SOONER,
    "setpoints in the air, attitude: attitude nan: *": _NO_NUMBERS,
    "setpoints in the air, attitude: attitude of zero length: *": _NO_NUMBERS,
    "setpoints in the air, attitude: rates nan: *": _NO_NUMBERS,
    "setpoints in the air, attitude: thrust nan: *": _NO_NUMBERS,
    "setpoints in the air, attitude: thrust [mb]o*: down": "thrust alone is open loop: charge and speed at the start decide",
    "setpoints in the air, attitude: thrust negative: *": "safer: refused; PX4 v1.16 flies its absolute value",
    "gps origin: before: may arm": _PLACE,
    "take off and land: height at the change": _CLIMB,
    "take off and land: take-off lasts": _CLIMB,
}
