"""Values of the parameters of the built-in autopilots, for all vehicles together.

`Params[name]` is an array over all vehicles, which the batched code reads without a copy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from arena.builtin_parameters import SPECS

Array = NDArray[np.float64]


class Params:
    """Values of all parameters for all vehicles of the built-in autopilot.

    version: increases with each write
    """

    def __init__(self, vehicles: int) -> None:
        self._values: dict[str, Array] = {
            name: np.full(vehicles, spec.default) for name, spec in SPECS.items()
        }
        self.names = sorted(SPECS)
        self.index = {name: i for i, name in enumerate(self.names)}
        self.version = 0

    def __getitem__(self, name: str) -> Array:
        """Return the values of a parameter (V,). Raises KeyError for an unknown name."""
        return self._values[name]

    def columns(self, *names: str) -> Array:
        """Return the values of several named parameters as one new array (V, number of names)."""
        return np.stack([self._values[name] for name in names], axis=-1)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def set(self, vehicle: int, name: str, value: float) -> None:
        """Write one parameter of one vehicle.

        Raises KeyError for an unknown name, ValueError for a value that is not finite or out of range.
        """
        spec = SPECS[name]
        if not np.isfinite(value) or not spec.low <= value <= spec.high:
            raise ValueError(f"{name} = {value}: must be within {spec.low:g} .. {spec.high:g}")
        if spec.type == "int32" and value != int(value):
            raise ValueError(f"{name} = {value}: must be an integer")
        self._values[name][vehicle] = value
        self.version += 1

    def load(self, vehicle: int, values: Mapping[str, float]) -> list[str]:
        """Write several parameters of one vehicle; return one message per refused value.

        As in PX4, a refused value does not prevent the boot.
        """
        problems = []
        for name, value in values.items():
            try:
                self.set(vehicle, name, float(value))
            except KeyError:
                problems.append(f"parameter {name} is unknown to the built-in autopilot")
            except ValueError as error:
                problems.append(str(error))
        return problems
