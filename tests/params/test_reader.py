"""Tests of reading the whole parameter list of one vehicle over a simulated link."""

from __future__ import annotations

import pytest
from fake_autopilot import INT32
from served import LossyLink

from .simulated_transfer import lossy_link, reader, run, sixty_params, vehicle


@pytest.mark.parametrize("seed", range(5))
def test_whole_list_is_read_over_a_lossy_link(seed: int) -> None:
    autopilot, core = vehicle(params={f"P_{i:03d}": (i, INT32) for i in range(300)}), reader()
    run(core, autopilot, lossy_link(seed))
    assert core.ending == "done" and core.missing == {}
    assert {name: value.value for name, value in core.values.items()} == {f"P_{i:03d}": i for i in range(300)}
    assert core.progress.n == core.progress.of == 300


def test_list_that_grows_is_read_again() -> None:
    autopilot, core = vehicle(), reader()

    def grow(now: float) -> None:
        if len(core.values) > 20:
            autopilot.params.setdefault("P_05A", (1, INT32))

    run(core, autopilot, LossyLink(delay_s=0.02), each=grow)
    assert core.ending == "done" and set(core.values) == {*sixty_params(), "P_05A"}


def test_list_that_stops_is_requested_again() -> None:
    autopilot, core = vehicle(list_per_turn=2), reader()
    stopped = []

    def stop(now: float) -> None:
        if len(core.values) > 5 and not stopped:
            stopped.append(now)
            autopilot.list_left = []

    run(core, autopilot, LossyLink(delay_s=0.02), each=stop)
    assert stopped and core.ending == "done" and set(core.values) == set(sixty_params())
