"""Filter for frames that could arm a vehicle or spin a motor while a preflight check fails. Pure.

A mode change never arms PX4. MAVLink FTP, parameters and the upload of missions always pass.
"""

from __future__ import annotations

from arena.authority import COMMANDS, MISSION_STARTS, Kind, command_of, parse_request
from arena.fcu_link.harmless_commands import HARMLESS
from arena.wire.mavlink_frame import Buffer, Frame


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
