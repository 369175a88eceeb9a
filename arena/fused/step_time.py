"""Clock of the parts of the process `world` when they run in one process (the fused arena)."""

from __future__ import annotations

from arena.clock import Rate

_CANNOT_SLEEP = (
    "a part of the process `world` wanted to sleep, which would stop the simulation. This is an error of arena: please report it. "
    "`arena up --processes` runs each part in a process of its own, where it can sleep"
)


class StepTime:
    """Clock that returns the simulation time of the present step. It cannot sleep.

    The simulation calls the parts of the process `world` in each step. A part that slept would stop the simulation.

    value: simulation time [s].
    """

    def __init__(self) -> None:
        self.value = 0.0

    def now(self) -> float:
        """Return the simulation time [s]."""
        return self.value

    def sleep_until(self, t: float) -> float:
        raise NotImplementedError(_CANNOT_SLEEP)

    def rate(self, hz: float) -> Rate:
        raise NotImplementedError(_CANNOT_SLEEP)
