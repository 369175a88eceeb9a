"""Several kinds of autopilots behind one interface: each gets the calls for its own rows."""

from __future__ import annotations

from typing import Any

import numpy as np

from arena.sim.autopilot_interface import CompositeAutopilots


class StubAutopilots:
    """Records how its radio control was switched, and the requests of the supervisor."""

    def __init__(self) -> None:
        self.switched: list[tuple[int, bool]] = []
        self.requests: list[Any] = []

    def sticks(self, vehicle: int, on: bool) -> None:
        self.switched.append((vehicle, on))

    def on_request(self, request: Any) -> None:
        self.requests.append(request)


def test_sticks_reach_the_autopilot_that_flies_the_row() -> None:
    one: Any = StubAutopilots()
    other: Any = StubAutopilots()
    composite = CompositeAutopilots([(np.array([0, 2]), one), (np.array([1]), other)], 3, 4)
    composite.sticks(2, False)
    composite.sticks(1, True)
    assert (one.switched, other.switched) == ([(1, False)], [(0, True)])


def test_requests_of_the_supervisor_reach_all_autopilots() -> None:
    one: Any = StubAutopilots()
    other: Any = StubAutopilots()
    CompositeAutopilots([(np.array([0]), one), (np.array([1]), other)], 2, 4).on_request({"do": "release"})
    assert one.requests == other.requests == [{"do": "release"}]
