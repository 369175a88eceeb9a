"""Several kinds of autopilots beside one world: each flies its own rows, together they look like one. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from arena.wire.truth import Truth

if TYPE_CHECKING:
    from arena.sim.loop import Pilots

Array = NDArray[np.float64]
Row = NDArray[np.intp]


class Mixed:
    """parts: (rows of the world, the autopilots that fly them). rotors: how many commands a row has."""

    def __init__(self, parts: Sequence[tuple[Row, Pilots]], vehicles: int, rotors: int) -> None:
        self._parts, self._shape = parts, (vehicles, rotors)
        self._home = {int(row): (pilots, i) for rows, pilots in parts for i, row in enumerate(rows)}

    @property
    def armed(self) -> NDArray[np.bool_]:
        found = np.zeros(self._shape[0], bool)
        for rows, pilots in self._parts:
            found[rows] = pilots.armed
        return found

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        pilots, i = self._home[vehicle]
        pilots.receive(i, link, data)

    def step(self, now: float, sensors: dict[str, Array]) -> Array:
        motors = np.zeros(self._shape)
        for rows, pilots in self._parts:
            found = pilots.step(now, {key: value[rows] for key, value in sensors.items()})
            motors[rows, : found.shape[1]] = found
        return motors

    def see(self, truth: Truth) -> None:
        """Hand each part that wants it the truth of its rows."""
        for rows, pilots in self._parts:
            see: Callable[[Truth], None] | None = getattr(pilots, "see", None)
            if see is not None:
                see(Truth(
                    time_s=truth.time_s, p_n=truth.p_n[rows], q_nb=truth.q_nb[rows], v_n=truth.v_n[rows],
                    omega_b=truth.omega_b[rows], accel_b=truth.accel_b[rows], motors=truth.motors[rows],
                ))  # fmt: skip

    def transmit(self) -> list[tuple[int, str, bytes]]:
        return [(int(rows[i]), link, data) for rows, pilots in self._parts for i, link, data in pilots.transmit()]

    def stats(self) -> dict[str, Any]:
        return {name: told for _, pilots in self._parts for name, told in pilots.stats().items()}

    def events(self) -> list[str]:
        return [text for _, pilots in self._parts for text in pilots.events()]

    def close(self) -> None:
        for _, pilots in self._parts:
            close: Callable[[], None] | None = getattr(pilots, "close", None)
            if close is not None:
                close()
