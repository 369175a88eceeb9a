"""What the world expects of those who fly its vehicles. Contracts alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from arena.wire.truth_page import Truth

Array = NDArray[np.float64]


class Pilots(Protocol):
    """The autopilots of all vehicles of this world, as `arena.autopilot` makes them."""

    @property
    def armed(self) -> NDArray[np.bool_]: ...

    def receive(self, vehicle: int, link: str, data: bytes) -> None: ...

    def sticks(self, vehicle: int, on: bool) -> None:
        """A pilot's radio goes on or off."""
        ...

    def step(self, now: float, sensors: dict[str, Array]) -> Array: ...

    def transmit(self) -> list[tuple[int, str, bytes]]: ...

    def stats(self) -> dict[str, Any]: ...

    def events(self) -> list[str]: ...


@runtime_checkable
class Outside(Protocol):
    """Autopilots in processes of their own: their step is in two halves, between which the world does other things.

    Each step: `see` the truth, `begin` with the sensors of the same instant, `finish` for the motor commands 0..1 (V, R).
    wants_gps: whether the sensors of the next `begin` are to hold the satellites' as well.
    """

    @property
    def wants_gps(self) -> bool: ...

    def see(self, truth: Truth) -> None: ...

    def begin(self, now: float, sensors: dict[str, Array]) -> None: ...

    def finish(self) -> Array: ...


MakePilots = Callable[[dict[str, Any], float], Pilots]
