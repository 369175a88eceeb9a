"""The built-in, PX4-compatible autopilot, batched over vehicles and stepped by the world."""

from arena.autopilot.autopilots import Autopilots

__all__ = ["Autopilots"]
