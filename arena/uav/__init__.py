"""The package for user programs: one vehicle's data, commands and setpoints.

It must not send a setpoint outside the caller's own call, and not depend on whether the vehicle is simulated.
"""

from arena.errors import (
    CommandRefusedError,
    NotConfirmedError,
    OffboardLostError,
    SetpointError,
    StaleDataError,
    VehicleError,
)
from arena.uav.data_groups import Snapshot
from arena.uav.heartbeat import Heartbeat
from arena.uav.vehicle import UAV

Heart = Heartbeat  # deprecated name

__all__ = [
    "UAV",
    "CommandRefusedError",
    "Heart",
    "Heartbeat",
    "NotConfirmedError",
    "OffboardLostError",
    "SetpointError",
    "Snapshot",
    "StaleDataError",
    "VehicleError",
]
