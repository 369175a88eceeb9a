"""Heartbeat of a ground station that the router sends to the vehicles."""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import ROUTER

_MAVLINK_2 = 3
_HEARTBEAT = mavlink.MAVLink_heartbeat_message(
    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, _MAVLINK_2
)


class GroundStation:
    """Encoder of the heartbeats that the router sends as a ground station.

    While PX4 receives these heartbeats, its data-link failsafe does not act.
    """

    def __init__(self) -> None:
        self._codec = Codec(ROUTER.system, ROUTER.component)

    def heartbeat(self) -> bytes:
        """Return the next ground station heartbeat as a MAVLink frame."""
        return self._codec.pack(_HEARTBEAT)
