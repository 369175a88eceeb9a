"""Filter for frames that could arm a vehicle or spin a motor while a preflight check fails. Pure.

A mode change never arms PX4. MAVLink FTP, parameters and the upload of missions always pass.
"""

from __future__ import annotations

import math
import re

from pymavlink.dialects.v20 import common as mavlink

from arena.authority import COMMANDS, MISSION_STARTS, Kind, command_of, parse_request
from arena.fcu_link.harmless_commands import HARMLESS
from arena.wire.mavlink_frame import Buffer, Frame

_SAY_NEW_S = 1.0  # a program requests arming once a second
_SAY_AGAIN_S = 10.0
_NUMBER = re.compile(r"\d+(\.\d+)?")


class RefusalReport:
    """Decides which refusals the user sees: one with new reasons soon, the same refusal every 10 s.

    Refusals that differ only in their numbers are the same.
    """

    def __init__(self) -> None:
        self._words, self._said_at = "", -math.inf

    def is_due(self, text: str, now: float) -> bool:
        """Return whether to show a refusal now. now: monotonic time [s]."""
        words = _NUMBER.sub("", text)
        if now - self._said_at < (_SAY_AGAIN_S if words == self._words else _SAY_NEW_S):
            return False
        self._words, self._said_at = words, now
        return True


def needs_checks(data: Buffer, frame: Frame, system: int, *, armed: bool) -> bool:
    """Return whether a frame may pass to the vehicle only if all preflight checks pass.

    armed: the vehicle is armed for certain; then only a request to arm waits. A broadcast (target system 0) is a frame to the vehicle, too.
    """
    if frame.target_sys not in (0, system):
        return False
    request = parse_request(data, frame)
    if request is None:
        return not armed and frame.msgid in COMMANDS and command_of(data, frame) not in HARMLESS
    if request.kind is Kind.SPIN:
        return not armed
    # these commands arm; in flight they only change the mode
    return request.kind is Kind.ARM and not (armed and request.command in MISSION_STARTS)


def request_words(data: Buffer, frame: Frame) -> str:
    """Return the request in a frame as text for the user, such as `arming` or `SERIAL_CONTROL`."""
    request = parse_request(data, frame)
    if request is not None and request.kind is Kind.ARM:
        return "arming"
    if command := command_of(data, frame):
        known = mavlink.enums["MAV_CMD"].get(command)
        return f"{known.name.removeprefix('MAV_CMD_')} (command {command})" if known else f"command {command}"
    name = mavlink.mavlink_map[frame.msgid].msgname
    return str(name)
