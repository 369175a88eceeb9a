"""Handlers of MAV_CMD commands.

Each handler acts on a vehicle and returns the MAV_RESULT of the acknowledgement.

PX4 accepts some meaningless arguments (NaN as "disarm", 0.5 as "arm", an unknown mode as "no change"). The
built-in autopilot denies them, so that the client learns of its mistake.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import events
from arena.autopilot.commander import CRITICAL, INFO
from arena.autopilot.flight_modes import Mode, mode_of
from arena.autopilot.mavlink import streams
from arena.autopilot.mavlink.link import MavlinkLink
from arena.autopilot.navigation.mission_items import MISSION
from arena.autopilot.navigation.orbit import OrbitRequest
from arena.autopilot.vehicle import RepositionTarget, Vehicle
from arena.constants import FORCE_ARM_DISARM, INT32_NOT_GIVEN
from arena.wire import px4_messages

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
_SHORTEST_INTERVAL_S = 0.004
_LONGEST_INTERVAL_S = 2147.0  # MESSAGE_INTERVAL cannot report a longer one


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """MAV_CMD command that a vehicle has received: its parameters, and the link for replies.

    link: link on which the command arrived; replies are sent on the same link
    params: param1 to param7, latitude and longitude in degrees
    send_now: sends the message with the given id on the link; returns False if it is not available
    """

    vehicle: Vehicle
    link: MavlinkLink
    params: tuple[float, ...]
    send_now: Callable[[int], bool]


Command = Callable[[Request], int]


def run(number: int, request: Request) -> int:
    """Run a command and return its MAV_RESULT.

    Until the vehicle has booted, every command returns TEMPORARILY_REJECTED.

    number: the MAV_CMD
    """
    command = COMMANDS.get(number)
    if not request.vehicle.booted:
        return TEMPORARILY_REJECTED
    if command is None:
        request.vehicle.counts["unsupported command"] += 1
        return UNSUPPORTED
    return command(request)


def parameters_of(m: Any) -> tuple[float, ...]:
    """Return param1 to param7 of COMMAND_LONG or COMMAND_INT, NaN for values that are not given.

    Latitude and longitude are converted to degrees.
    """
    if m.get_msgId() == mavlink.MAVLINK_MSG_ID_COMMAND_LONG:
        return (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
    x, y = (math.nan if v == INT32_NOT_GIVEN else v * 1e-7 for v in (m.x, m.y))
    return (m.param1, m.param2, m.param3, m.param4, x, y, m.z)


def _arm_disarm(r: Request) -> int:
    p = r.params
    if p[0] == 1.0:
        done = r.vehicle.arm()  # forced arming skips no check, as on PX4
    elif p[0] == 0.0:
        done = r.vehicle.disarm(force=p[1] == FORCE_ARM_DISARM)
    else:
        text = f"Unsupported ARM_DISARM param: {p[0]:.3f}"
        r.vehicle.commander.report(CRITICAL, text, events.ARM_PARAMETER(p[0]))
        return DENIED
    return _accepted_or_rejected(done)


def _accepted_or_rejected(done: bool) -> int:
    return ACCEPTED if done else TEMPORARILY_REJECTED


def _set_mode(r: Request) -> int:
    p = r.params
    if not all(math.isfinite(x) for x in p[:3]) or not int(p[0]) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    return _accepted_or_rejected(r.vehicle.request_mode(mode_of(int(p[1]), int(p[2]))))


def _land(r: Request) -> int:
    return _accepted_or_rejected(r.vehicle.request_mode(Mode.LAND))


def _takeoff(r: Request) -> int:
    return _accepted_or_rejected(r.vehicle.request_takeoff(r.params[6]))


def _return(r: Request) -> int:
    result = _accepted_or_rejected(r.vehicle.request_mode(Mode.RTL))
    if result == ACCEPTED:
        r.vehicle.commander.report(INFO, "Returning to launch", events.RETURN())
    return result


def _mission_start(r: Request) -> int:
    v, first = r.vehicle, r.params[0]
    if not v.inputs.mission_ok:
        v.commander.report(CRITICAL, "Mission start denied! No valid mission", events.NO_MISSION())
        return DENIED
    if not (math.isfinite(first) and -1 <= first < len(v.missions.items[0])):
        return DENIED
    return _accepted_or_rejected(v.request_mode(Mode.MISSION) and v.arm(why="by mission start"))


def _reposition(r: Request) -> int:
    p = r.params
    if not math.isfinite(p[1]) or int(p[1]) != mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
        return UNSUPPORTED
    if any(math.isinf(x) for x in p) or not _is_place(p[4], p[5], p[6]):
        return DENIED
    target = RepositionTarget(lat=p[4], lon=p[5], alt=p[6], yaw=p[3])
    return _accepted_or_rejected(r.vehicle.request_reposition(target, p[0]))


def _orbit(r: Request) -> int:
    """Fly on a circle (MAV_CMD_DO_ORBIT).

    The mode is AUTO.LOITER. PX4 reports POSCTL with the sub mode ORBIT, which looks like a manual mode.
    """
    p = r.params
    if any(math.isinf(x) for x in p) or not _is_place(p[4], p[5], p[6]):
        return DENIED
    request = OrbitRequest(radius=p[0], speed=p[1], yaw=p[2], lat=p[4], lon=p[5], alt=p[6])
    return _accepted_or_rejected(r.vehicle.request_orbit(request))


def _change_speed(r: Request) -> int:
    speed = r.params[1]
    r.vehicle.requested_speed = speed if math.isfinite(speed) and speed > 0 else -1.0
    return ACCEPTED


def _set_home(r: Request) -> int:
    p = r.params
    if p[0] > 0.5:
        return _accepted_or_rejected(r.vehicle.set_home_here())
    place = p[4:7]
    if not all(math.isfinite(x) for x in place) or not _is_place(*place):
        return DENIED
    return _accepted_or_rejected(r.vehicle.set_home_at(*place))


def _inject_failure(r: Request) -> int:
    return r.vehicle.inject_failure(r.params)


def _is_place(lat: float, lon: float, alt: float) -> bool:
    """Return whether latitude, longitude [deg] and altitude [m] are within their valid ranges.

    NaN is valid: it means that the present value is kept.
    """
    return not (abs(lat) > 90.0 or abs(lon) > 180.0 or abs(alt) > 1e5)


def _set_message_interval(r: Request) -> int:
    """Set the interval of a message stream on this link [us].

    A negative value stops the stream, 0 restores the default.

    The interval of HEARTBEAT cannot be changed.
    """
    p, link = r.params, r.link
    if not all(math.isfinite(x) for x in p[:2]) or any(
        math.isfinite(x) and abs(x) >= 0.5 for x in (p[2], p[3], p[6])
    ):
        return FAILED
    msgid, us = math.floor(p[0] + 0.5), p[1]
    if msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT or msgid not in streams.SUPPORTED:
        return FAILED
    default = streams.LINK_RATES[link.name].get(msgid, 0.0)
    interval = (1.0 / default if default else 0.0) if us == 0 else us * 1e-6 if us > 0 else 0.0
    interval = min(max(interval, _SHORTEST_INTERVAL_S), _LONGEST_INTERVAL_S) if interval else 0.0
    link.streams.set_interval(msgid, interval, r.vehicle.now + interval)
    return ACCEPTED


def _get_message_interval(r: Request) -> int:
    """Reply with the interval of a message stream [us]; 0 if the message is not streamed on this link."""
    if not math.isfinite(r.params[0]) or not 0 <= r.params[0] < 65535.5:
        return DENIED
    msgid = math.floor(r.params[0] + 0.5)
    us = int(r.link.streams.interval(msgid) * 1e6)
    r.link.send(mavlink.MAVLink_message_interval_message(msgid, us))
    return ACCEPTED


def _request_message(r: Request) -> int:
    if not math.isfinite(r.params[0]):
        return DENIED
    return ACCEPTED if r.send_now(round(r.params[0])) else DENIED


def _request_fixed(msgid: int) -> Command:
    return lambda r: ACCEPTED if r.send_now(msgid) else DENIED


def _reboot(r: Request) -> int:
    action = r.params[0]
    if action == 0.0:
        return ACCEPTED
    if action not in (1.0, 3.0) or r.vehicle.commander.armed:
        return DENIED
    r.vehicle.reboot_requested = True
    return ACCEPTED


def _terminate(r: Request) -> int:
    if not (math.isfinite(r.params[0]) and r.params[0] > 0.5 and r.vehicle.commander.armed):
        return DENIED
    r.vehicle.terminate("by command")
    return ACCEPTED


def _set_mission_current(r: Request) -> int:
    """Select the mission item to fly next (MAV_CMD_DO_SET_MISSION_CURRENT).

    PX4 v1.16 supports this only by the message MISSION_SET_CURRENT.
    """
    index, store = r.params[0], r.vehicle.missions
    if not (math.isfinite(index) and 0 <= index < len(store.items[MISSION])):
        return DENIED
    store.set_current(int(index))
    return ACCEPTED


def _actuator_test(r: Request) -> int:
    v = r.vehicle
    return v.actuator_tests.request(r.params, v.now, v.rotors, armed=v.commander.armed)


def _calibrate(r: Request) -> int:
    """Refuse a sensor calibration with a text in PX4's format, which ground stations parse.

    A request to end a calibration is accepted.
    """
    if r.vehicle.commander.armed:
        return TEMPORARILY_REJECTED
    if not any(math.isfinite(x) and int(x) for x in r.params):
        return ACCEPTED
    r.vehicle.commander.report(CRITICAL, "[cal] calibration failed: simulated sensors need no calibration")
    return DENIED


def _run_prearm_checks(r: Request) -> int:
    return ACCEPTED


COMMANDS: dict[int, Command] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_NAV_LAND: _land,
    mavlink.MAV_CMD_NAV_TAKEOFF: _takeoff,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _return,
    mavlink.MAV_CMD_MISSION_START: _mission_start,
    mavlink.MAV_CMD_DO_REPOSITION: _reposition,
    mavlink.MAV_CMD_DO_ORBIT: _orbit,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    mavlink.MAV_CMD_DO_SET_HOME: _set_home,
    mavlink.MAV_CMD_GET_HOME_POSITION: _request_fixed(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_message_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: _get_message_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _request_message,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _request_fixed(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: _request_fixed(px4_messages.PROTOCOL_VERSION),
    mavlink.MAV_CMD_REQUEST_FLIGHT_INFORMATION: _request_fixed(mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION),
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: _set_mission_current,
    mavlink.MAV_CMD_ACTUATOR_TEST: _actuator_test,
    mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: _calibrate,
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: _run_prearm_checks,
    mavlink.MAV_CMD_INJECT_FAILURE: _inject_failure,
}
