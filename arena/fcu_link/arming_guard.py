"""Detection of requests to arm a vehicle, and the reply that refuses them while a preflight check fails.
Pure.

The refusal is sent in the name of the autopilot. PX4 arms on COMPONENT_ARM_DISARM (also with its force value)
and on MISSION_START; a pilot can arm with a stick gesture. DO_SET_MODE and SET_MODE never arm. As in PX4, any
value that rounds to 0 disarms.
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
_COMMAND_OFFSET = 28  # in both messages, after seven numbers of four bytes


def command_of(data: Buffer, frame: Frame) -> int:
    """Return the MAV_CMD of a command message; 0 for any other message."""
    return uint_at(data, frame, _COMMAND_OFFSET, 2) if frame.msgid in _COMMANDS else 0


def asks_to_arm(data: Buffer, frame: Frame, system: int) -> bool:
    """Return whether a frame would arm vehicle `system`. Commands to all vehicles (broadcasts) count too."""
    if frame.target_sys not in (0, system):
        return False
    command = command_of(data, frame)
    if command == mavlink.MAV_CMD_MISSION_START:
        return True
    return command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and not _disarms(data, frame)


def pack_refusal(codec: Codec, data: Buffer, frame: Frame, reasons: Sequence[str]) -> bytes:
    """Encode the reply to a refused request to arm: one STATUSTEXT per reason, then the COMMAND_ACK.

    codec: encodes messages in the name of the autopilot
    reasons: most severe first; empty if they were sent a moment ago
    The texts are sent first, so that a client has them when it reads the acknowledgement. The most severe
    reason is sent last.
    """
    severity = mavlink.MAV_SEVERITY_ERROR
    texts = [
        mavlink.MAVLink_statustext_message(severity, r.encode()[:TEXT_BYTES], 0, 0) for r in reversed(reasons)
    ]
    rejected = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    ack = mavlink.MAVLink_command_ack_message(
        command_of(data, frame), rejected, 0, 0, frame.sysid, frame.compid
    )
    return b"".join(codec.pack(m) for m in (*texts, ack))


def _disarms(data: Buffer, frame: Frame) -> bool:
    (param1,) = struct.unpack("<f", uint_at(data, frame, 0, 4).to_bytes(4, "little"))
    return not math.isfinite(param1) or abs(param1) < 0.5
