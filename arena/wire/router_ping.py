"""PING message with which a tool asks the router for the telemetry of a vehicle. Pure.

The PING registers its sender as a tool.

The router does not forward a PING that is addressed to the router. So its sender counts for no vehicle as ground station, program or pilot.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_ids import ROUTER

PING_PERIOD_S = 2.0
"""Time between two PINGs [s]. The router forgets a tool that is silent for 10 s."""


def ping_router() -> mavlink.MAVLink_ping_message:
    """Return a PING that is addressed to the router."""
    return mavlink.MAVLink_ping_message(0, 0, ROUTER.system, ROUTER.component)
