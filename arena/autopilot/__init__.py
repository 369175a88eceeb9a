"""The built-in, PX4-compatible autopilot. The world steps it; all vehicles are computed as one batch."""

from arena.autopilot.autopilots import Autopilots

__all__ = ["Autopilots"]
