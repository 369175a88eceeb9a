"""Batteries of V vehicles: the motors use up charge, and the voltage drops under load. Pure, batched.

    current = idle + (hover - idle) * mean((spin / spin at hover)^2)
    voltage = cells * (empty + (full - empty) * remaining) - resistance * current

Electrical power is proportional to thrust^(3/2) (momentum theory: Leishman, "Principles of helicopter
aerodynamics", 2006, chapter 2). With the thrust curves of our profiles this is close to the square of the
command.

The voltage is that of an ideal source with an inner resistance. This is the first-order equivalent circuit of
Chen and Rincon-Mora ("Accurate electrical battery model", IEEE Transactions on Energy Conversion 21(2), 2006)
without its slow parts.

An empty battery drives no motor: below the charge RESERVE the motors follow a smaller part of their commands,
and none at zero charge. The real end of a discharge depends on cells and motor controllers; this one is linear.

If a profile has `thrust_at_v`, thrust depends on the voltage (see
arena/vehicle_models/multirotor_dynamics.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESERVE = 0.02
"""Charge below which the motors lose thrust 0..1 [-]. An assumption, not measured."""


@dataclass(frozen=True, kw_only=True)
class _Pack:
    """Battery parameters of one vehicle, from the section `battery` of its profile.

    Charge [mA h], voltages of one cell without load [V], inner resistance [Ohm], currents [A].
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
    """Charge and voltage of each vehicle's battery, updated by `step`.

    profiles: profiles of the vehicles
    hover: motor command at which each vehicle hovers [-] (V,)
    supply_per_volt: actuator supply per volt [1/V], 0 if thrust does not depend on the voltage (V,)
    step_s: duration of a step [s]

    is_weak: True if the charge of any battery is below RESERVE

    The attributes `voltage` [V], `current` [A] and `remaining` 0..1 [-], each (V,), are valid after
    construction and after each step.
    """

    def __init__(
        self, profiles: Sequence[Mapping[str, Any]], hover: Array, supply_per_volt: Array, *, step_s: float
    ) -> None:
        packs = [_Pack(**profile.get("battery", {})) for profile in profiles]
        names = [f.name for f in fields(_Pack) if f.name != "thrust_at_v"]
        of: dict[str, Any] = {name: np.array([getattr(p, name) for p in packs], float) for name in names}
        rotors = np.array([len(profile["rotors"]) for profile in profiles], float)
        self._idle, self._resistance = of["idle_a"], of["resistance_ohm"]
        self._per_square = (of["hover_a"] - of["idle_a"]) / (rotors * hover**2)
        self._empty = of["cells"] * of["empty_cell_v"]
        self._span = of["cells"] * (of["full_cell_v"] - of["empty_cell_v"])
        self._used_per_a = step_s / (3.6 * of["capacity_mah"])
        self.remaining: Array = of["remaining"]
        self._step_s = step_s
        self._overrides: dict[int, float] = {}  # vehicle -> share of the charge used in one step
        self._supply_per_volt = supply_per_volt
        self.step(np.zeros((len(packs), 1)))

    def step(self, spin: Array) -> None:
        """Advance charge and voltage of all batteries by one step.

        spin: rotor state during the step, 0..1 [-] (V, R)
        """
        self.current = self._idle + self._per_square * np.add.reduce(spin * spin, 1)
        used = self.current * self._used_per_a
        for vehicle, share in self._overrides.items():
            used[vehicle] = share
        self.remaining = np.maximum(self.remaining - used, 0.0)
        self.is_weak = bool(self.remaining.min() < RESERVE)
        self.voltage = self._empty + self._span * self.remaining - self._resistance * self.current

    def override_discharge(self, vehicle: int, empty_in_s: float | None) -> None:
        """Set a constant discharge rate of one battery, independent of the current.

        empty_in_s: time from full to empty [s]; None restores the load model
        """
        self._overrides.pop(vehicle, None)
        if empty_in_s is not None:
            self._overrides[vehicle] = self._step_s / empty_in_s

    @property
    def strength(self) -> Array:
        """Share of the commands that the motors follow at the present charge, 0..1 [-] (V, 1)."""
        return np.minimum(self.remaining / RESERVE, 1.0)[:, None]

    @property
    def supply(self) -> Array:
        """Factor on the motor commands [-] (V,). It models that motors turn slower at a lower battery voltage.

        The factor is the voltage divided by the voltage at which the thrust curve was measured. It is 1 if
        thrust does not depend on the voltage.
        """
        per_volt = self._supply_per_volt
        return np.where(per_volt > 0.0, self.voltage * per_volt, 1.0)
