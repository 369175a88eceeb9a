"""The differences that stay: pattern of `case: observation` -> why. A difference that none explains fails."""

from __future__ import annotations

_SAFER = "safer: nothing comes back into OFFBOARD by itself (the pilot wins); PX4 returns to it with the next setpoint or pose"
_AFTER = "safer: after landing and disarming it stands in HOLD; PX4 goes back to the mode that was asked for last"
_THRUST = (
    "safer: an attitude without a thrust, or with one that is no number, is refused; PX4 v1.16 flies it with thrust 0 and falls"
)
_RANGE = "safer: a value that is not finite or out of its documented range is answered with the old one; PX4 v1.16 takes anything"
_STREAMS = "nothing there that it could tell: ESCs, vibration, remote id, events, link statistics, time to target"
_SENSORS = "the sensors that are there differ: no compass, logger and stick receiver, but vision"
_STICKS = "no sticks: modes flown by hand do not exist; the failsafes that ask for them land"
_ARGUMENTS = "an argument that makes no sense is denied; PX4 acknowledges it and does nothing, or something else"
_TWICE = "PX4 v1.16 acknowledges MAV_CMD_DO_SET_MODE twice, accepted first; only the answer that counts is sent"
_TERMINATES = "flight termination is told as a mode and a state of its own; PX4's heartbeat goes on as it was"
_NO_REBOOT = "a SITL of PX4 cannot reboot and denies it; here the estimator begins anew"
_INTERVAL = "an interval shorter than a step is the step; PX4 stops the stream"
_CLOCK = "no calendar: the pure core has simulation time alone"
_JUMP = "safer: a pose that jumps is rejected, then declared lost; PX4 follows it"

_PROTOCOL = "PROTOCOL_VERSION is deprecated and not in the dialect: AUTOPILOT_VERSION says the same"
_FTP = "no files: FTP is not there"
_PLACE = "needs no place on the globe to arm in HOLD; the arena's forwarder tells one"
_CLIMB = "AUTO.TAKEOFF ends at its height; PX4's ends within NAV_MC_ALT_RAD below it and climbs on in HOLD"

KNOWN: dict[str, str] = {
    "offboard lost and found: with setpoints again": _SAFER,
    "offboard lost and found: a gap*": _SAFER,
    "poses lost and found: *": _SAFER,
    "*: mode after disarming": _AFTER,
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
    "rates, disarmed: VIBRATION *": _STREAMS,
    "rates, disarmed: OPEN_DRONE_ID*": _STREAMS,
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
    "message interval: ATTITUDE after nan*": _ARGUMENTS,
    "message interval: ATTITUDE after infinite*": _ARGUMENTS,
    "request message: nan: ack": _ARGUMENTS,
    "request message: infinite: ack": _ARGUMENTS,
    "reboot: ack": _NO_REBOOT,
    "terminated in the air: *": _TERMINATES,
    "offboard lost, action 6 *": _TERMINATES,
    "hit and turned over: *": _TERMINATES,
    "poses jump: *": _JUMP,
    "parameter write: hash: read after": "another set of parameters has another hash",
    "parameter list: count": "only the parameters that mean something to it are there",
    "capabilities: capabilities*": _FTP,
    "capabilities: protocol version*": _PROTOCOL,
    "request message: id 300*": _PROTOCOL,
    "gps origin: before: may arm": _PLACE,
    "take off and land: height at the change": _CLIMB,
    "take off and land: take-off lasts": _CLIMB,
}
