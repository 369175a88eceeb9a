"""Batteries of a whole fleet: charge used by the motors, voltage that sags under load. Pure, batched, and
simple on purpose.

    current = idle + (hover - idle) * mean((spin / spin at hover)^2)
    voltage = cells * (empty + (full - empty) * remaining) - resistance * current

Electrical power goes with thrust to the 3/2, which lies near the square of the command for the curves we
have.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.sim.fleet import Fleet

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class _Pack:
    """The `battery` of a profile: charge [mA h], voltages of a cell at no load [V], inner resistance [Ohm],
    currents [A].
    """

    cells: float = 4
    capacity_mah: float = 5000.0
    full_cell_v: float = 4.2
    empty_cell_v: float = 3.5
    resistance_ohm: float = 0.03
    idle_a: float = 0.5
    hover_a: float = 20.0
    remaining: float = 1.0


class Battery:
    """voltage [V], current [A], remaining 0..1 [-], each (V,)."""

    def __init__(self, fleet: Fleet, *, step_s: float) -> None:
        packs = [_Pack(**profile.get("battery", {})) for profile in fleet.profiles]
        of: dict[str, Any] = {f.name: np.array([getattr(p, f.name) for p in packs], float) for f in fields(_Pack)}
        rotors = np.array([len(profile["rotors"]) for profile in fleet.profiles], float)
        self._idle, self._resistance = of["idle_a"], of["resistance_ohm"]
        self._per_square = (of["hover_a"] - of["idle_a"]) / (rotors * fleet.hover**2)
        self._empty, self._span = (
            of["cells"] * of["empty_cell_v"],
            of["cells"] * (of["full_cell_v"] - of["empty_cell_v"]),
        )
        self._used_per_a = step_s / (3.6 * of["capacity_mah"])
        self.remaining: Array = of["remaining"]
        self.step(np.zeros((fleet.size, 1)))

    def step(self, spin: Array) -> None:
        """spin: what the rotors do, 0..1 (V, R), held for one step."""
        self.current = self._idle + self._per_square * (spin * spin).sum(axis=1)
        self.remaining = np.maximum(self.remaining - self.current * self._used_per_a, 0.0)
        self.voltage = self._empty + self._span * self.remaining - self._resistance * self.current
