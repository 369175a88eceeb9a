"""Filter for frames that could arm a vehicle or spin a motor while a preflight check fails. Pure.

A mode change never arms PX4. MAVLink FTP, parameters and the upload of missions always pass.

PX4 reports that it is disarmed only once a second, in its HEARTBEAT. So a vehicle on the ground is treated like a disarmed
one, although it was armed a moment ago. Stick positions are an exception: PX4 treats missing stick positions of an armed
vehicle as a lost radio. So only the stick gesture that arms is dropped.
"""

from __future__ import annotations

from arena.authority import COMMANDS, MISSION_STARTS, Kind, command_of, parse_request
from arena.fcu_link.harmless_commands import HARMLESS
from arena.wire.age_limits import MANUAL_INPUTS
from arena.wire.mavlink_frame import Buffer, Frame, uint_at

_MANUAL_CONTROL = 69
_THROTTLE_OFFSET, _YAW_OFFSET = 4, 6
_LOW_THROTTLE, _RIGHT_YAW = 100, 900  # limits of PX4's stick gesture that arms (ManualControl.cpp, v1.16)


def needs_checks(data: Buffer, frame: Frame, system: int, *, flying: bool) -> bool:
    """Return whether a frame may pass to the vehicle only if all preflight checks pass.

    A broadcast (target system 0) is a frame to the vehicle, too.

    flying: the vehicle is armed for certain, and does not report that it is on the ground; then only a request to arm waits
    """
    if frame.target_sys not in (0, system):
        return False
    request = parse_request(data, frame)
    if request is None:
        return not flying and frame.msgid in COMMANDS and command_of(data, frame) not in HARMLESS
    if request.kind in (Kind.SPIN, Kind.FAILURE):
        return not flying
    # these commands arm; in flight they only change the mode
    return request.kind is Kind.ARM and not (flying and request.command in MISSION_STARTS)


def sticks_can_arm(data: Buffer, frame: Frame, *, armed: bool, on_ground: bool) -> bool:
    """Return whether a frame has stick positions that can arm the vehicle. They may pass only if all preflight checks pass.

    armed: as in the last HEARTBEAT
    on_ground: the vehicle reports that it is on the ground; False if this is unknown
    """
    if frame.msgid not in MANUAL_INPUTS:
        return False
    return not armed or (on_ground and frame.msgid == _MANUAL_CONTROL and _is_arming_gesture(data, frame))


def _is_arming_gesture(data: Buffer, frame: Frame) -> bool:
    """Return whether a MANUAL_CONTROL has the throttle stick at the bottom and the yaw stick at the right end."""
    yaw = uint_at(data, frame, _YAW_OFFSET, 2)
    return uint_at(data, frame, _THROTTLE_OFFSET, 2) < _LOW_THROTTLE and _RIGHT_YAW < yaw <= 1000
