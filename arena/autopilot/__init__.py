"""The built-in, PX4-compatible autopilot. The world (the simulator process) advances all vehicles together, as one batch of arrays."""

from arena.autopilot.autopilots import Autopilots

__all__ = ["Autopilots"]
