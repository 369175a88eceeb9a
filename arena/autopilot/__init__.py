"""The built-in, PX4-compatible autopilot. The world (the simulator process) advances all vehicles together, as one batch of arrays."""

from arena.autopilot.autopilots import Autopilots
from arena.autopilot.ulog.files import UlogFiles

__all__ = ["Autopilots", "UlogFiles"]
