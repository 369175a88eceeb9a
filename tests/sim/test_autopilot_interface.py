"""Several kinds of autopilots behind one interface: each gets the calls for its own rows."""

from __future__ import annotations

from typing import Any

import numpy as np

from arena.sim.autopilot_interface import CompositeAutopilots


class StubAutopilots:
    """Records how its radio control was switched."""

    def __init__(self) -> None:
        self.switched: list[tuple[int, bool]] = []

    def sticks(self, vehicle: int, on: bool) -> None:
        self.switched.append((vehicle, on))


def test_sticks_reach_the_autopilot_that_flies_the_row() -> None:
    one: Any = StubAutopilots()
    other: Any = StubAutopilots()
    composite = CompositeAutopilots([(np.array([0, 2]), one), (np.array([1]), other)], 3, 4)
    composite.sticks(2, False)
    composite.sticks(1, True)
    assert (one.switched, other.switched) == ([(1, False)], [(0, True)])
