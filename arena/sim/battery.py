"""Batteries of a whole fleet: charge used by the motors, voltage that sags under load. Pure, batched, and
simple on purpose.

    current = idle + (hover - idle) * mean((spin / spin at hover)^2)
    voltage = cells * (empty + (full - empty) * remaining) - resistance * current

Electrical power goes with thrust to the 3/2 (momentum theory: Leishman, "Principles of helicopter aerodynamics", 2006,
chapter 2), which lies near the square of the command for the curves we have. The voltage is that of an ideal source behind
an inner resistance, the first-order equivalent circuit of Chen and Rincon-Mora ("Accurate electrical battery model", IEEE
Transactions on Energy Conversion 21(2), 2006) without its slow parts: it sags with the current and recovers with it.
Where a profile has `thrust_at_v` the rotors feel it (see rotors.py).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.sim.vehicle_arrays import Fleet

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
    thrust_at_v: float | None = None


class Battery:
    """voltage [V], current [A], remaining 0..1 [-], each (V,). supply: of the rotors, per nominal [-] (V, 1)."""

    def __init__(self, fleet: Fleet, *, step_s: float) -> None:
        packs = [_Pack(**profile.get("battery", {})) for profile in fleet.profiles]
        figures = [f.name for f in fields(_Pack) if f.name != "thrust_at_v"]
        of: dict[str, Any] = {name: np.array([getattr(p, name) for p in packs], float) for name in figures}
        rotors = np.array([len(profile["rotors"]) for profile in fleet.profiles], float)
        self._idle, self._resistance = of["idle_a"], of["resistance_ohm"]
        self._per_square = (of["hover_a"] - of["idle_a"]) / (rotors * fleet.hover**2)
        self._empty, self._span = (
            of["cells"] * of["empty_cell_v"],
            of["cells"] * (of["full_cell_v"] - of["empty_cell_v"]),
        )
        self._used_per_a = step_s / (3.6 * of["capacity_mah"])
        self.remaining: Array = of["remaining"]
        self._step_s = step_s
        self._pace: dict[int, float] = {}
        self._per_volt = fleet.per_volt
        self.step(np.zeros((fleet.size, 1)))

    def step(self, spin: Array) -> None:
        """spin: what the rotors do, 0..1 (V, R), held for one step."""
        self.current = self._idle + self._per_square * np.add.reduce(spin * spin, 1)
        used = self.current * self._used_per_a
        for vehicle, share in self._pace.items():
            used[vehicle] = share
        self.remaining = np.maximum(self.remaining - used, 0.0)
        self.voltage = self._empty + self._span * self.remaining - self._resistance * self.current

    def drain(self, vehicle: int, empty_in_s: float | None) -> None:
        """From now on it falls at the pace full to empty in so long, whatever the motors draw. None: as they draw."""
        self._pace.pop(vehicle, None)
        if empty_in_s is not None:
            self._pace[vehicle] = self._step_s / empty_in_s

    @property
    def supply(self) -> Array:
        return np.where(self._per_volt > 0.0, self.voltage * self._per_volt, 1.0)[:, None]
