"""Several kinds of autopilots beside one world: each hears what is meant for its own rows."""

from __future__ import annotations

from typing import Any

import numpy as np

from arena.sim.composite_autopilot import Mixed


class Listening:
    """Autopilots that keep what is switched."""

    def __init__(self) -> None:
        self.heard: list[tuple[int, bool]] = []

    def sticks(self, vehicle: int, on: bool) -> None:
        self.heard.append((vehicle, on))


def test_a_radio_is_switched_for_the_vehicle_of_that_row_whoever_flies_it() -> None:
    one: Any = Listening()
    other: Any = Listening()
    mixed = Mixed([(np.array([0, 2]), one), (np.array([1]), other)], 3, 4)
    mixed.sticks(2, False)
    mixed.sticks(1, True)
    assert (one.heard, other.heard) == ([(1, False)], [(0, True)])
