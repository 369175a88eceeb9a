"""MAV_CMD by MAV_CMD: what each does to a vehicle and how it is acknowledged. Called by the face for commands meant for it.

Where PX4 would take an argument that makes no sense for something (NaN for "disarm", 0.5 for "arm", no mode for "no change"), the
command is denied here: a client that sends nonsense should hear of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.commander import CRITICAL, INFO, WARNING, Mode, mode_of
from arena.autopilot.mavlink import streams

if TYPE_CHECKING:
    from arena.autopilot.mavlink.mavlink_interface import Face, Link

Parameters = tuple[float, ...]
Command = Callable[["Face", "Link", Parameters], int]

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
FORCE_MAGIC = 21196.0
_SHORTEST_S, _LONGEST_S = 0.004, 2147.0  # between messages; MESSAGE_INTERVAL tells no longer one
_UNSAID = 2**31 - 1  # INT32_MAX in COMMAND_INT: no place given


def obey(f: Face, link: Link, number: int, p: Parameters) -> int:
    """-> MAV_RESULT. Before the first sensors nothing can be decided."""
    command = COMMANDS.get(number)
    if f.sensed is None or f.limits is None:
        return TEMPORARILY_REJECTED
    if command is None:
        f.counts["unsupported command"] += 1
        return UNSUPPORTED
    return command(f, link, p)


def parameters_of(m: Any) -> Parameters:
    """param1 to 7 of COMMAND_LONG or COMMAND_INT, places in degrees."""
    if m.get_msgId() == mavlink.MAVLINK_MSG_ID_COMMAND_LONG:
        return (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
    x, y = (math.nan if v == _UNSAID else v * 1e-7 for v in (m.x, m.y))
    return (m.param1, m.param2, m.param3, m.param4, x, y, m.z)


def _arm_disarm(f: Face, link: Link, p: Parameters) -> int:
    assert f.sensed and f.limits  # obey asked
    if p[0] == 1.0:
        why = f.commander.arm(f.sensed, f.limits)  # PX4 checks before arming even by force
    elif p[0] == 0.0:
        why = f.commander.disarm(f.sensed, force=p[1] == FORCE_MAGIC)
    else:
        f.commander.say(CRITICAL, f"Unsupported ARM_DISARM param: {p[0]:.3f}")
        return DENIED
    return TEMPORARILY_REJECTED if why else ACCEPTED


def _change_mode(f: Face, mode: Mode | None) -> int:
    assert f.sensed and f.limits
    return TEMPORARILY_REJECTED if f.commander.request_mode(mode, f.sensed, f.limits) else ACCEPTED


def _set_mode(f: Face, link: Link, p: Parameters) -> int:
    if not all(math.isfinite(x) for x in p[:3]) or not int(p[0]) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    return _change_mode(f, mode_of(int(p[1]), int(p[2])))


def _land(f: Face, link: Link, p: Parameters) -> int:
    return _change_mode(f, Mode.LAND)


def _takeoff(f: Face, link: Link, p: Parameters) -> int:
    f.takeoff_d = f.origin[2] - p[6] if f.origin and math.isfinite(p[6]) and p[6] != 0.0 else math.nan
    return _change_mode(f, Mode.TAKEOFF)


def _return(f: Face, link: Link, p: Parameters) -> int:
    result = _change_mode(f, Mode.RTL)
    if result == ACCEPTED:
        f.commander.say(INFO, "Returning to launch")
    return result


def _mission_start(f: Face, link: Link, p: Parameters) -> int:
    assert f.sensed and f.limits
    if not f.sensed.mission_ok:
        f.commander.say(CRITICAL, "Mission start denied! No valid mission")
        return DENIED
    if not (math.isfinite(p[0]) and -1 <= p[0] < len(f.missions.items[0])):
        return DENIED
    result = _change_mode(f, Mode.MISSION)
    if result == ACCEPTED and f.commander.arm(f.sensed, f.limits, why="by mission start"):
        return TEMPORARILY_REJECTED
    return result


def _reposition(f: Face, link: Link, p: Parameters) -> int:
    if not math.isfinite(p[1]) or int(p[1]) != mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
        return UNSUPPORTED
    if any(math.isinf(x) for x in p) or not _is_place(p[4], p[5], p[6], given=False):
        return DENIED
    result = _change_mode(f, Mode.HOLD)
    if result == ACCEPTED and f.commander.armed:
        f.goto = (p[4], p[5], p[6], p[3])
        f.speed_asked = p[0] if p[0] > 0 else f.speed_asked
    return result


def _change_speed(f: Face, link: Link, p: Parameters) -> int:
    f.speed_asked = p[1] if math.isfinite(p[1]) and p[1] > 0 else -1.0
    return ACCEPTED


def _set_home(f: Face, link: Link, p: Parameters) -> int:
    if p[0] > 0.5:
        return ACCEPTED if f.set_home_here() else TEMPORARILY_REJECTED
    if not _is_place(p[4], p[5], p[6], given=True):
        return DENIED
    return ACCEPTED if f.set_home_there(p[4], p[5], p[6]) else TEMPORARILY_REJECTED


def _inject(f: Face, link: Link, p: Parameters) -> int:
    result = f.failures.inject(p, enabled=bool(f.params["SYS_FAILURE_EN"][f.i]))
    if result == ACCEPTED:
        f.commander.say(WARNING, f"Failure injected: unit {p[0]:.0f}, type {p[1]:.0f}, instance {p[2]:.0f}")
    return result


def _is_place(lat: float, lon: float, alt: float, *, given: bool) -> bool:
    """Degrees and metres on this planet. given: all of them must be numbers; else NaN stands for "as it is"."""
    if given and not all(math.isfinite(x) for x in (lat, lon, alt)):
        return False
    return not (abs(lat) > 90.0 or abs(lon) > 180.0 or abs(alt) > 1e5)


def _set_interval(f: Face, link: Link, p: Parameters) -> int:
    """Negative: off; 0: as the link has it by itself. HEARTBEAT's cannot be changed."""
    if not all(math.isfinite(x) for x in p[:2]) or any(
        math.isfinite(x) and abs(x) >= 0.5 for x in (p[2], p[3], p[6])
    ):
        return FAILED
    msgid, us = math.floor(p[0] + 0.5), p[1]
    if msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT or msgid not in streams.TOLD:
        return FAILED
    default = streams.LINK_RATES[link.name].get(msgid, 0.0)
    interval = (1.0 / default if default else 0.0) if us == 0 else us * 1e-6 if us > 0 else 0.0
    f.schedule(link, msgid, min(max(interval, _SHORTEST_S), _LONGEST_S) if interval else 0.0)
    return ACCEPTED


def _get_interval(f: Face, link: Link, p: Parameters) -> int:
    """0 for whatever is not sent by itself on this link."""
    if not math.isfinite(p[0]) or not 0 <= p[0] < 65535.5:
        return DENIED
    msgid = math.floor(p[0] + 0.5)
    f.send(link, mavlink.MAVLink_message_interval_message(msgid, int(link.interval.get(msgid, 0.0) * 1e6)))
    return ACCEPTED


def _request(f: Face, link: Link, p: Parameters) -> int:
    if not math.isfinite(p[0]):
        return DENIED
    return ACCEPTED if f.tell_now(link, round(p[0])) else DENIED


def _request_fixed(msgid: int) -> Command:
    return lambda f, link, p: ACCEPTED if f.tell_now(link, msgid) else DENIED


def _reboot(f: Face, link: Link, p: Parameters) -> int:
    if p[0] == 0.0:
        return ACCEPTED
    if p[0] not in (1.0, 3.0) or f.commander.armed:
        return DENIED
    f.reboot_asked = True
    return ACCEPTED


def _terminate(f: Face, link: Link, p: Parameters) -> int:
    if not (math.isfinite(p[0]) and p[0] > 0.5 and f.commander.armed):
        return DENIED
    f.commander.terminate(f.now, "by command")
    return ACCEPTED


def _prearm_checks(f: Face, link: Link, p: Parameters) -> int:
    return ACCEPTED


COMMANDS: dict[int, Command] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_NAV_LAND: _land,
    mavlink.MAV_CMD_NAV_TAKEOFF: _takeoff,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _return,
    mavlink.MAV_CMD_MISSION_START: _mission_start,
    mavlink.MAV_CMD_DO_REPOSITION: _reposition,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    mavlink.MAV_CMD_DO_SET_HOME: _set_home,
    mavlink.MAV_CMD_GET_HOME_POSITION: _request_fixed(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _request,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _request_fixed(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: _prearm_checks,
    mavlink.MAV_CMD_INJECT_FAILURE: _inject,
}
