"""The package for user programs: data, commands and setpoints of one vehicle.

It must not send a setpoint outside a call of the user program, and must not depend on whether the vehicle is
simulated.
"""

from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from arena.uav.async_vehicle import AsyncUAV
    from arena.uav.simulated_loop import run
    from arena.uav.swarm import Swarm

Heart = Heartbeat  # deprecated name
_ASYNCHRONOUS = {"AsyncUAV": "async_vehicle", "Swarm": "swarm", "run": "simulated_loop"}

__all__ = [
    "UAV",
    "AsyncUAV",
    "CommandRefusedError",
    "Fleet",
    "Heart",
    "Heartbeat",
    "NotConfirmedError",
    "OffboardLostError",
    "SetpointError",
    "Snapshot",
    "StaleDataError",
    "Swarm",
    "VehicleError",
    "run",
]


def __getattr__(name: str) -> Any:
    """Import a class for asynchronous programs when a program first uses it.

    asyncio takes 30 ms to load, and blocking programs do not need it.
    """
    if name in _ASYNCHRONOUS:
        from importlib import import_module

        return getattr(import_module(f"arena.uav.{_ASYNCHRONOUS[name]}"), name)
    raise AttributeError(f"module 'arena.uav' has no attribute {name!r}")
