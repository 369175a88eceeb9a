"""Discharge of batteries: current, charge and voltage, computed from the state of the rotors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.arrays import floats, view

if TYPE_CHECKING:
    from arena.kernels.arrays import Array


class BatteryDischarge:
    """Batteries of V vehicles, discharged by their rotors.

    spin: input: rotor state 0..1 [-] (V, R)
    idle, per_square: current at rest, and per sum of the squared rotor states [A] (V,)
    used_per_a: share of the charge that 1 A uses in one step [1/A] (V,)
    override: share of the charge used in one step instead of that by the current; negative for none [-] (V,)
    empty, span: voltage without charge and without load, and its gain up to the full charge [V] (V,)
    resistance: inner resistance [Ohm] (V,)
    supply_per_volt: actuator supply per volt, 0 if thrust does not depend on the voltage [1/V] (V,)
    remaining: charge 0..1 [-] (V,)
    current, voltage: output: [A], [V] (V,)
    supply: output: factor on the motor commands [-] (V,)
    """

    def __init__(self, spin: Array) -> None:
        v, self.rotors = spin.shape
        self.spin, self.override = view(spin), floats(v, fill=-1.0)
        self.idle, self.per_square, self.used_per_a = floats(v), floats(v), floats(v)
        self.empty, self.span, self.resistance = floats(v), floats(v), floats(v)
        self.supply_per_volt, self.remaining = floats(v), floats(v)
        self.current, self.voltage, self.supply = floats(v), floats(v), floats(v, fill=1.0)

    def step(self) -> float:
        """Advance all batteries by one step. Return the smallest remaining charge, 0..1 [-]."""
        least = 1.0
        for i in range(len(self.remaining)):
            squares = 0.0
            for k in range(self.rotors):
                squares += self.spin[i, k] * self.spin[i, k]
            current = self.idle[i] + self.per_square[i] * squares
            used = self.override[i]
            if used < 0.0:
                used = current * self.used_per_a[i]
            remaining = max(self.remaining[i] - used, 0.0)
            voltage = self.empty[i] + self.span[i] * remaining - self.resistance[i] * current
            self.current[i], self.remaining[i], self.voltage[i] = current, remaining, voltage
            if self.supply_per_volt[i] > 0.0:
                self.supply[i] = voltage * self.supply_per_volt[i]
            least = min(least, remaining)
        return least
