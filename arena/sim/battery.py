"""Batteries of V vehicles. The motors discharge them, and the voltage drops under load. Pure, batched.

    current = idle + (hover - idle) * mean((spin / spin at hover)^2)
    voltage = cells * (empty + (full - empty) * remaining) - resistance * current

Electrical power is proportional to thrust^(3/2) (momentum theory: Leishman, "Principles of helicopter
aerodynamics", 2006, chapter 2). With the thrust curves of our profiles this is close to the square of the
command.

The voltage is that of an ideal source with an inner resistance. This is the first-order equivalent circuit of
Chen and Rincon-Mora ("Accurate electrical battery model", IEEE Transactions on Energy Conversion 21(2), 2006)
without its slow parts.

An empty battery drives no motor: below the charge RESERVE the motor commands are multiplied by a factor,
which falls to 0 at zero charge. The real end of a discharge depends on cells and motor controllers; this one is linear.

If a profile has `thrust_at_v`, thrust depends on the voltage (see
arena/vehicle_models/multirotor_dynamics.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.kernels.arrays import array
from arena.kernels.battery_discharge import BatteryDischarge

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
    spin: rotor state 0..1, which `step` reads [-] (V, R)
    step_s: duration of a step [s]

    is_weak: True if the charge of any battery is below RESERVE

    The attributes `voltage` [V], `current` [A] and `remaining` 0..1 [-], each (V,), are valid after construction, and
    each step changes them. So is `supply` [-] (V,), the factor on the motor commands: motors turn slower at a lower
    voltage. It is the voltage divided by that at which the thrust curve was measured, or 1 if thrust does not depend on it.
    """

    def __init__(
        self,
        profiles: Sequence[Mapping[str, Any]],
        hover: Array,
        supply_per_volt: Array,
        *,
        spin: Array,
        step_s: float,
    ) -> None:
        packs = [_Pack(**profile.get("battery", {})) for profile in profiles]
        names = [f.name for f in fields(_Pack) if f.name != "thrust_at_v"]
        of: dict[str, Any] = {name: np.array([getattr(p, name) for p in packs], float) for name in names}
        rotors = np.array([len(profile["rotors"]) for profile in profiles], float)
        self._law = law = BatteryDischarge(spin)
        array(law.idle)[:], array(law.resistance)[:] = of["idle_a"], of["resistance_ohm"]
        array(law.per_square)[:] = (of["hover_a"] - of["idle_a"]) / (rotors * hover**2)
        array(law.empty)[:] = of["cells"] * of["empty_cell_v"]
        array(law.span)[:] = of["cells"] * (of["full_cell_v"] - of["empty_cell_v"])
        array(law.used_per_a)[:] = step_s / (3.6 * of["capacity_mah"])
        array(law.supply_per_volt)[:] = supply_per_volt
        self._override = array(law.override)
        self.current, self.voltage, self.supply = array(law.current), array(law.voltage), array(law.supply)
        self.remaining = array(law.remaining)
        self.remaining[:] = of["remaining"]
        self._step_s = step_s
        self.step()

    def step(self) -> None:
        """Advance charge and voltage of all batteries by one step."""
        self.is_weak = self._law.step() < RESERVE

    def override_discharge(self, vehicle: int, empty_in_s: float | None) -> None:
        """Set a constant discharge rate of one battery. It replaces the rate that follows from the current.

        empty_in_s: time from full to empty [s]; None restores the load model
        """
        self._override[vehicle] = -1.0 if empty_in_s is None else self._step_s / empty_in_s

    @property
    def command_factor(self) -> Array:
        """Return a factor (0 to 1) for the motor commands of each vehicle (V, 1). A nearly empty battery gives less thrust.

        It falls from 1 at the charge RESERVE to 0 for an empty battery.
        """
        return np.minimum(self.remaining / RESERVE, 1.0)[:, None]
