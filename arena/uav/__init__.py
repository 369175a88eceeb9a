"""What a user program imports: one vehicle's data, commands and setpoints.

It must not send a setpoint outside the caller's own call, and not know whether the vehicle is simulated.
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
from arena.uav.heartbeat import Heart
from arena.uav.vehicle import UAV

__all__ = [
    "UAV",
    "CommandRefusedError",
    "Heart",
    "NotConfirmedError",
    "OffboardLostError",
    "SetpointError",
    "Snapshot",
    "StaleDataError",
    "VehicleError",
]
