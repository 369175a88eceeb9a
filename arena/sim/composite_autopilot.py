"""Several kinds of autopilots beside one world: each flies its own rows, together they look like one. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.sim.autopilot_interface import Outside, Pilots
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]
Row = NDArray[np.intp]


class Mixed:
    """parts: (rows of the world, the autopilots that fly them). rotors: how many commands a row has."""

    def __init__(self, parts: Sequence[tuple[Row, Pilots]], vehicles: int, rotors: int) -> None:
        self._parts, self._shape = parts, (vehicles, rotors)
        self._outside = [pilots if isinstance(pilots, Outside) else None for _, pilots in parts]
        self._home = {int(row): (pilots, i) for rows, pilots in parts for i, row in enumerate(rows)}

    @property
    def armed(self) -> NDArray[np.bool_]:
        found = np.zeros(self._shape[0], bool)
        for rows, pilots in self._parts:
            found[rows] = pilots.armed
        return found

    @property
    def wants_gps(self) -> bool:
        return any(outside is not None and outside.wants_gps for outside in self._outside)

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        pilots, i = self._home[vehicle]
        pilots.receive(i, link, data)

    def sticks(self, vehicle: int, on: bool) -> None:
        pilots, i = self._home[vehicle]
        pilots.sticks(i, on)

    def step(self, now: float, sensors: dict[str, Array]) -> Array:
        self.begin(now, sensors)
        return self.finish()

    def begin(self, now: float, sensors: dict[str, Array]) -> None:
        """Those outside this process begin; the others have their turn in `finish`."""
        self._now, self._sensors = (
            now,
            [{key: value[rows] for key, value in sensors.items()} for rows, _ in self._parts],
        )
        for outside, part in zip(self._outside, self._sensors, strict=True):
            if outside is not None:
                outside.begin(now, part)

    def finish(self) -> Array:
        motors = np.zeros(self._shape)
        for (rows, pilots), outside, part in zip(self._parts, self._outside, self._sensors, strict=True):
            found = pilots.step(self._now, part) if outside is None else outside.finish()
            motors[rows, : found.shape[1]] = found
        return motors

    def see(self, truth: Truth) -> None:
        """Hand each part that wants it the truth of its rows."""
        for (rows, _), outside in zip(self._parts, self._outside, strict=True):
            if outside is not None:
                outside.see(
                    Truth(
                        time_s=truth.time_s,
                        p_n=truth.p_n[rows],
                        q_nb=truth.q_nb[rows],
                        v_n=truth.v_n[rows],
                        omega_b=truth.omega_b[rows],
                        accel_b=truth.accel_b[rows],
                        motors=truth.motors[rows],
                    )
                )

    def transmit(self) -> list[tuple[int, str, bytes]]:
        return [
            (int(rows[i]), link, data) for rows, pilots in self._parts for i, link, data in pilots.transmit()
        ]

    def stats(self) -> dict[str, Any]:
        return {name: told for _, pilots in self._parts for name, told in pilots.stats().items()}

    def events(self) -> list[str]:
        return [text for _, pilots in self._parts for text in pilots.events()]

    def close(self) -> None:
        for _, pilots in self._parts:
            close: Callable[[], None] | None = getattr(pilots, "close", None)
            if close is not None:
                close()
