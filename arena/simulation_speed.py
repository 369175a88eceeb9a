"""Speed of a simulation or replay, as in `sim.speed` and `--speed`: a number, or "max" for as fast as possible.

Standard library only.
"""

from __future__ import annotations

import math


def speed_of(value: float | str) -> float:
    """Return a configured speed as a number [simulated seconds per second of wall time]. "max" gives inf."""
    return math.inf if value == "max" else float(value)


def slowdown(value: float | str) -> float:
    """Return the factor on time limits for simulated vehicles: 2.0 at speed 0.5; 1.0 in real time and faster."""
    return max(1.0, 1.0 / speed_of(value))
