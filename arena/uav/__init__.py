"""The package for user programs: data, commands and setpoints of one vehicle.

It must not send a setpoint outside a call of the user program, and must not depend on whether the vehicle is
simulated.
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
from arena.uav.fleet import Fleet
from arena.uav.heartbeat import Heartbeat
from arena.uav.vehicle import UAV

Heart = Heartbeat  # deprecated name

__all__ = [
    "UAV",
    "CommandRefusedError",
    "Fleet",
    "Heart",
    "Heartbeat",
    "NotConfirmedError",
    "OffboardLostError",
    "SetpointError",
    "Snapshot",
    "StaleDataError",
    "VehicleError",
]
