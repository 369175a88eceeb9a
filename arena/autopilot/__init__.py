"""The built-in, PX4-compatible autopilot: batched over vehicles, stepped by the world beside the bodies it flies."""

from arena.autopilot.autopilots import Autopilots

__all__ = ["Autopilots"]
