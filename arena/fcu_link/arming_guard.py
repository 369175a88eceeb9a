"""Detection of requests to arm a vehicle, which the link refuses while a preflight check fails. Pure.

PX4 arms on COMPONENT_ARM_DISARM (also with its force value)
and on MISSION_START; a pilot can arm with a stick gesture. DO_SET_MODE and SET_MODE never arm. As in PX4, any
value that rounds to 0 disarms.
"""

from __future__ import annotations

import math
import struct

from pymavlink.dialects.v20 import common as mavlink

from arena.authority import command_of
from arena.wire.mavlink_frame import Buffer, Frame, uint_at

STICKS = (mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE)


def asks_to_arm(data: Buffer, frame: Frame, system: int) -> bool:
    """Return whether a frame would arm vehicle `system`. Commands to all vehicles (broadcasts) count too."""
    if frame.target_sys not in (0, system):
        return False
    command = command_of(data, frame)
    if command == mavlink.MAV_CMD_MISSION_START:
        return True
    return command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and not _disarms(data, frame)


def _disarms(data: Buffer, frame: Frame) -> bool:
    (param1,) = struct.unpack("<f", uint_at(data, frame, 0, 4).to_bytes(4, "little"))
    return not math.isfinite(param1) or abs(param1) < 0.5
