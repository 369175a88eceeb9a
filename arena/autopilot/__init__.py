"""Built-in autopilot of simulated vehicles, compatible with PX4.

The world (the simulator process) advances the autopilots of all vehicles together, as arrays with one row per
vehicle.
"""

from arena.autopilot.autopilots import Autopilots
from arena.autopilot.ulog.files import UlogFiles

__all__ = ["Autopilots", "UlogFiles"]
