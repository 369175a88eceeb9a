"""Tests of reading the whole parameter list of one vehicle over a simulated link."""

from __future__ import annotations

import pytest

from .simulated_vehicle import INT32, LossyLink, Vehicle, lossy_link, reader, run, sixty_params


@pytest.mark.parametrize("seed", range(5))
def test_whole_list_is_read_over_a_lossy_link(seed: int) -> None:
    vehicle, core = Vehicle(params={f"P_{i:03d}": (i, INT32) for i in range(300)}), reader()
    run(core, vehicle, lossy_link(seed))
    assert core.ending == "done" and core.missing == {}
    assert {name: value.value for name, value in core.values.items()} == {f"P_{i:03d}": i for i in range(300)}
    assert core.progress.n == core.progress.of == 300


def test_list_that_grows_is_read_again() -> None:
    vehicle, core = Vehicle(), reader()

    def grow(now: float) -> None:
        if len(core.values) > 20:
            vehicle.params.setdefault("P_05A", (1, INT32))

    run(core, vehicle, LossyLink(delay_s=0.02), each=grow)
    assert core.ending == "done" and set(core.values) == {*sixty_params(), "P_05A"}


def test_list_that_stops_is_requested_again() -> None:
    vehicle, core = Vehicle(per_turn=2), reader()
    stopped = []

    def stop(now: float) -> None:
        if len(core.values) > 5 and not stopped:
            stopped.append(now)
            vehicle._left = []

    run(core, vehicle, LossyLink(delay_s=0.02), each=stop)
    assert stopped and core.ending == "done" and set(core.values) == set(sixty_params())
