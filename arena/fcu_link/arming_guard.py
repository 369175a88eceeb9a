"""What asks a vehicle to arm, and the answer in its autopilot's name while a gate does not hold. Pure.

PX4 arms on COMPONENT_ARM_DISARM (its force magic does not change that) and on MISSION_START, and a pilot's sticks arm by a
gesture. DO_SET_MODE and SET_MODE never arm. Disarming is whatever rounds to 0, as PX4 reads it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.preflight_checks import TEXT_BYTES
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Buffer, Frame, uint_at

_COMMANDS = (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)
STICKS = (mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE)
_COMMAND_AT = 28  # in both messages: seven numbers of four bytes stand before it


def command_of(data: Buffer, frame: Frame) -> int:
    """The command that it carries, or 0."""
    return uint_at(data, frame, _COMMAND_AT, 2) if frame.msgid in _COMMANDS else 0


def asks_to_arm(data: Buffer, frame: Frame, system: int) -> bool:
    """Would this, let through, arm `system`? Broadcasts count."""
    if frame.target_sys not in (0, system):
        return False
    command = command_of(data, frame)
    if command == mavlink.MAV_CMD_MISSION_START:
        return True
    return command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and not _disarms(data, frame)


def _disarms(data: Buffer, frame: Frame) -> bool:
    (wanted,) = struct.unpack("<f", uint_at(data, frame, 0, 4).to_bytes(4, "little"))
    return not math.isfinite(wanted) or abs(wanted) < 0.5


def refusal(voice: Codec, data: Buffer, frame: Frame, reasons: Sequence[str]) -> bytes:
    """The reasons, then the answer: whoever waits for the answer has them by then. reasons: none when they were told just now."""
    severity, last = mavlink.MAV_SEVERITY_ERROR, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    # Gravest last: clients that show the newest few, as arena's own programs do, show those.
    texts = [
        mavlink.MAVLink_statustext_message(severity, r.encode()[:TEXT_BYTES], 0, 0) for r in reversed(reasons)
    ]
    ack = mavlink.MAVLink_command_ack_message(command_of(data, frame), last, 0, 0, frame.sysid, frame.compid)
    return b"".join(voice.pack(m) for m in (*texts, ack))
