"""Reading the whole list of one vehicle, over the air of simulated time."""

from __future__ import annotations

import pytest

from .simulated_vehicle import INT32, Air, Vehicle, reader, rough, run, sixty


@pytest.mark.parametrize("seed", range(5))
def test_the_whole_list_is_read_with_what_was_lost_of_it(seed: int) -> None:
    vehicle, core = Vehicle(params={f"P_{i:03d}": (i, INT32) for i in range(300)}), reader()
    run(core, vehicle, rough(seed))
    assert core.ending == "done" and core.missing == {}
    assert {name: value.value for name, value in core.values.items()} == {f"P_{i:03d}": i for i in range(300)}
    assert core.progress.n == core.progress.of == 300


def test_a_list_that_grows_while_it_is_read_is_read_anew() -> None:
    vehicle, core = Vehicle(), reader()

    def grow(now: float) -> None:
        if len(core.values) > 20:
            vehicle.params.setdefault("P_05A", (1, INT32))

    run(core, vehicle, Air(delay_s=0.02), each=grow)
    assert core.ending == "done" and set(core.values) == {*sixty(), "P_05A"}


def test_a_list_that_another_program_stops_is_asked_for_again() -> None:
    vehicle, core = Vehicle(per_turn=2), reader()
    stopped = []

    def stop(now: float) -> None:
        if len(core.values) > 5 and not stopped:
            stopped.append(now)
            vehicle._left = []

    run(core, vehicle, Air(delay_s=0.02), each=stop)
    assert stopped and core.ending == "done" and set(core.values) == set(sixty())
