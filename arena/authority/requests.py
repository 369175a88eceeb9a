"""Parser of requests in MAVLink frames: set a mode, arm, disarm, spin a motor, follow a setpoint.

The meaning of each command is PX4's. Frames that do not move the vehicle give None.
"""

from __future__ import annotations

import math
import struct
from enum import Enum
from typing import NamedTuple

from arena.constants import FORCE_ARM_DISARM
from arena.wire.age_limits import MANUAL_INPUTS, SETPOINTS
from arena.wire.mavlink_frame import Buffer, Frame, uint_at
from arena.wire.px4_mode import mode_words, split_mode

COMMAND_INT, COMMAND_LONG, SET_MODE, PARAM_SET, SERIAL_CONTROL, TUNNEL = 75, 76, 11, 23, 126, 385
COMMANDS = frozenset({COMMAND_INT, COMMAND_LONG})
MESSAGES = COMMANDS | SETPOINTS | MANUAL_INPUTS | {SET_MODE, PARAM_SET, SERIAL_CONTROL, TUNNEL}
"""Messages for which `parse_request` may return a request."""
_PARAM_ID_OFFSET = 6  # in PARAM_SET, after the value and the target
_COMMAND_OFFSET = 28  # in COMMAND_INT and COMMAND_LONG, after seven numbers of four bytes
_NAV_LOITER, _NAV_RTL, _NAV_LAND, _NAV_TAKEOFF, _DO_ORBIT, _DO_REPOSITION = 17, 20, 21, 22, 34, 192
_NAV_PRECLAND, _NAV_VTOL_TAKEOFF, _DO_CHANGE_ALTITUDE = 23, 84, 186
_DO_SET_MODE, _DO_TERMINATE, _DO_STANDARD_MODE = 176, 185, 262
_DO_LAND_START, _MISSION_START, _ARM_DISARM = 189, 300, 400
MISSION_STARTS = frozenset({_DO_LAND_START, _MISSION_START})
"""Commands that arm PX4 and start its mission. PX4's navigator sends MISSION_START itself when it receives DO_LAND_START."""
_PREFLIGHT_CALIBRATION, _PREFLIGHT_UAVCAN, _INJECT_FAILURE = 241, 243, 420
_ESC_PASSTHROUGH = 211  # MAV_TUNNEL_PAYLOAD_TYPE_MODALAI_ESC_UART_PASSTHRU
_SPINS = frozenset({183, 187, 209, 310, 311})
"""DO_SET_SERVO, DO_SET_ACTUATOR, DO_MOTOR_TEST, ACTUATOR_TEST, CONFIGURE_ACTUATOR."""
_COMMANDED_MODES = {
    _NAV_LOITER: "AUTO.LOITER",
    _NAV_RTL: "AUTO.RTL",
    _NAV_LAND: "AUTO.LAND",
    _NAV_TAKEOFF: "AUTO.TAKEOFF",
    _DO_ORBIT: "ORBIT",
    _DO_REPOSITION: "REPOSITION",
    _DO_CHANGE_ALTITUDE: "REPOSITION",
    _NAV_PRECLAND: "AUTO.PRECLAND",
    _NAV_VTOL_TAKEOFF: "AUTO.VTOL_TAKEOFF",
}
UNCLEAR_MODE = "unclear mode"
"""Mode of a request with a number outside 0 to 255. Each processor converts such numbers differently."""
_ROS2_MODES = frozenset(f"AUTO.{sub}" for sub in range(11, 19))  # EXTERNAL1 to EXTERNAL8 of PX4
PROGRAM_MODES = _ROS2_MODES | {
    "OFFBOARD",
    "AUTO.MISSION",
    "AUTO.TAKEOFF",
    "AUTO.VTOL_TAKEOFF",
    "AUTO.FOLLOW_TARGET",
    "AUTO.PRECLAND",
    "ORBIT",
    "REPOSITION",
    UNCLEAR_MODE,
}
"""Modes in which a computer moves the vehicle. In AUTO.PRECLAND it may climb to 10 m (PLD_SRCH_ALT) to search for its target."""
_CUSTOM_MODE, _AUTO, _GUIDED, _STABILIZE, _MANUAL = 1, 4, 8, 16, 64  # MAV_MODE_FLAG
_AUTO_MAIN_MODE, _SET_MODE_BASE_OFFSET = 4, 5
_STANDARD_MODES = {
    1: "POSCTL",
    2: "ORBIT",
    4: "ALTCTL",
    5: "AUTO.RTL",
    6: "AUTO.MISSION",
    7: "AUTO.LAND",
    8: "AUTO.TAKEOFF",
}


class Kind(Enum):
    """Kind of request to a vehicle, such as arming or a change of the flight mode.

    SETPOINT: fly to a setpoint, in OFFBOARD. MANUAL_INPUT: stick positions. MODE: change the flight mode.
    ARM, DISARM: start or stop the motors. KILL: stop the motors also in flight. SPIN: turn a motor without arming.
    WRITE: write a parameter. FAILURE: inject a failure, such as of a motor.
    """

    SETPOINT = "setpoint"
    MANUAL_INPUT = "manual input"
    MODE = "mode"
    ARM = "arm"
    DISARM = "disarm"
    KILL = "kill"
    SPIN = "spin a motor"
    WRITE = "write parameter"
    FAILURE = "inject a failure"


MOVING_KINDS = frozenset({Kind.ARM, Kind.SPIN, Kind.FAILURE})
"""Kinds of requests that can always move the vehicle. SPIN also contains the shell of the autopilot, which can change the mode."""


class Request(NamedTuple):
    """Request that a MAVLink frame makes to a vehicle, such as to arm or to change the flight mode.

    mode: for MODE the name of the requested mode, else "". command: MAV_CMD, 0 for other messages.
    param: for WRITE the name of the parameter, else "".
    """

    kind: Kind
    mode: str = ""
    command: int = 0
    param: str = ""


_SETPOINT, _MANUAL_INPUT = Request(Kind.SETPOINT), Request(Kind.MANUAL_INPUT)


def command_of(data: Buffer, frame: Frame) -> int:
    """Return the MAV_CMD of a command message; 0 for any other message."""
    return uint_at(data, frame, _COMMAND_OFFSET, 2) if frame.msgid in COMMANDS else 0


def parse_request(data: Buffer, frame: Frame) -> Request | None:
    """Return the request in a frame; None for a frame without effect on motion, motors or parameters.

    The target of the frame is not checked.
    """
    if frame.msgid in SETPOINTS:
        return _SETPOINT
    if frame.msgid in COMMANDS:
        return _of_command(data, frame)
    if frame.msgid in MANUAL_INPUTS:
        return _MANUAL_INPUT
    if frame.msgid == SET_MODE:
        base = uint_at(data, frame, _SET_MODE_BASE_OFFSET, 1)
        return Request(Kind.MODE, _set_mode_words(base, *split_mode(uint_at(data, frame, 0, 4))))
    if frame.msgid == PARAM_SET:
        name = uint_at(data, frame, _PARAM_ID_OFFSET, 16).to_bytes(16, "little")
        return Request(Kind.WRITE, param=name.partition(b"\0")[0].decode(errors="replace"))
    if frame.msgid == SERIAL_CONTROL:  # a shell of the autopilot: it can arm and spin motors
        return Request(Kind.SPIN)
    if frame.msgid == TUNNEL and uint_at(data, frame, 0, 2) == _ESC_PASSTHROUGH:  # bytes for the ESCs
        return Request(Kind.SPIN)
    return None


def _of_command(data: Buffer, frame: Frame) -> Request | None:
    command = command_of(data, frame)
    if command == _ARM_DISARM:
        return Request(_arming_kind(data, frame), command=command)
    if command == _DO_SET_MODE:
        return Request(
            Kind.MODE, _set_mode_words(*(_byte(_number(data, frame, i)) for i in range(3))), command
        )
    if command == _DO_STANDARD_MODE:
        mode = _byte(_number(data, frame, 0) + 0.5)  # PX4 rounds this number
        words = UNCLEAR_MODE if mode is None else _STANDARD_MODES.get(mode, f"standard mode {mode}")
        return Request(Kind.MODE, words, command)
    if command in _COMMANDED_MODES:
        return Request(Kind.MODE, _COMMANDED_MODES[command], command)
    if command in MISSION_STARTS:
        return Request(Kind.ARM, command=command)
    if command == _DO_TERMINATE:
        return Request(Kind.KILL, command=command)
    return _of_motor_command(command, data, frame)


def _of_motor_command(command: int, data: Buffer, frame: Frame) -> Request | None:
    # PX4 cuts 1.9 to 1
    calibrates_esc = command == _PREFLIGHT_CALIBRATION and _is_set(_number(data, frame, 6))
    configures = command == _PREFLIGHT_UAVCAN and _is_set(_number(data, frame, 0))
    if command in _SPINS or calibrates_esc or configures:
        return Request(Kind.SPIN, command=command)
    # PX4 rounds the type of the failure; 0 (FAILURE_TYPE_OK) ends a failure
    if command == _INJECT_FAILURE and not -1.5 < _number(data, frame, 1) < 0.5:
        return Request(Kind.FAILURE, command=command)
    return None


def _set_mode_words(base_mode: int | None, main: int | None, sub: int | None) -> str:
    """Return the name of the mode that PX4 selects for DO_SET_MODE and SET_MODE.

    PX4 uses the main mode and the sub mode only if `base_mode` has the flag CUSTOM_MODE_ENABLED.
    None stands for a number outside 0 to 255: the result is then UNCLEAR_MODE.
    """
    if base_mode is None or main is None or sub is None:
        return UNCLEAR_MODE
    if base_mode & _CUSTOM_MODE:
        return "AUTO.MISSION" if (main, sub) == (_AUTO_MAIN_MODE, 0) else mode_words(main << 16 | sub << 24)
    if base_mode & _AUTO:
        return "AUTO.MISSION"
    if base_mode & _MANUAL:
        return "POSCTL" if base_mode & _GUIDED else "STABILIZED" if base_mode & _STABILIZE else "MANUAL"
    return f"base mode {base_mode}"  # PX4 changes nothing


def _arming_kind(data: Buffer, frame: Frame) -> Kind:
    """Return the kind of an arming command: ARM, DISARM or KILL (forced disarming).

    As in PX4, a command disarms if its param1 is not finite, or is between -0.5 and 0.5.
    """
    if abs(value := _number(data, frame, 0)) >= 0.5 and math.isfinite(value):
        return Kind.ARM
    forced = abs(_number(data, frame, 1) - FORCE_ARM_DISARM) < 0.5
    return Kind.KILL if forced else Kind.DISARM


def _number(data: Buffer, frame: Frame, index: int) -> float:
    """Return one parameter of a command message. index: 0 for param1, 6 for param7."""
    (value,) = struct.unpack("<f", uint_at(data, frame, 4 * index, 4).to_bytes(4, "little"))
    return float(value)


def _is_set(value: float) -> bool:
    """Return whether a parameter of a MAVLink command is used: it is neither 0 nor NaN.

    By MAVLink's convention, 0 and NaN mean "not used".
    """
    return value != 0.0 and not math.isnan(value)


def _byte(value: float) -> int | None:
    """Return a number of a command as PX4 converts it to a byte: its fraction is cut, and NaN becomes 0.

    None if the number does not fit in a byte, because the result then depends on the processor of the autopilot.
    """
    if math.isnan(value):
        return 0
    return int(value) if -1.0 < value < 256.0 else None
