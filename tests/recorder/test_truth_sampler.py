"""True states at a fixed rate, from the page that the world writes."""

from __future__ import annotations

import numpy as np
import pytest

from arena.recorder.truth_sampler import TruthSampler
from arena.wire.truth_page import Truth, TruthReader, TruthWriter

STEP_S = 0.004


class Page:
    """Truth page of one vehicle, whose north is the simulation time."""

    def __init__(self, path) -> None:
        self._writer = TruthWriter(path, 1, period_s=STEP_S)
        self.reader = TruthReader(path)
        self.steps = 0

    def write_until(self, time_s: float) -> None:
        while self.steps * STEP_S <= time_s + 1e-9:
            row = np.zeros((1, 3))
            now = self.steps * STEP_S
            self._writer.write(
                Truth(
                    time_s=now,
                    p_n=np.array([[now, 0.0, 0.0]]),
                    q_nb=np.array([[1.0, 0.0, 0.0, 0.0]]),
                    v_n=row,
                    omega_b=row,
                    accel_b=row,
                    motors=np.zeros((1, 4)),
                )
            )
            self.steps += 1


@pytest.fixture
def page(tmp_path):
    return Page(tmp_path / "truth")


@pytest.mark.parametrize("rate_hz", [1.0, 30.0, 100.0, 250.0])
def test_states_are_those_at_multiples_of_the_period(page, rate_hz):
    sampler, found = TruthSampler(page.reader, rate_hz, simulation_clock=True), []
    for wake in range(101):
        page.write_until(0.02 * wake)
        found += sampler.due(0.02 * wake)
    times = [time_s for time_s, _ in found]
    assert times == [k / rate_hz for k in range(round(2.0 * rate_hz) + 1)]
    assert [float(truth.p_n[0, 0]) for _, truth in found] == pytest.approx(times, abs=1e-9)


def test_nothing_is_returned_twice(page):
    sampler = TruthSampler(page.reader, 30.0, simulation_clock=True)
    page.write_until(1.0)
    assert list(sampler.due(1.0))
    assert list(sampler.due(1.0)) == []


def test_states_before_the_page_begins_are_left_out_after_a_stall(page):
    sampler = TruthSampler(page.reader, 100.0, simulation_clock=True)
    page.write_until(0.1)
    list(sampler.due(0.1))
    page.write_until(60.0)
    found = list(sampler.due(60.0))
    assert found[-1][0] == 60.0
    assert 0 < len(found) < 250
    assert all(truth.p_n[0, 0] == pytest.approx(time_s) for time_s, truth in found)


def test_unix_times_are_converted_by_the_smallest_delay(page):
    unix_s = 1.7e9
    sampler, found = TruthSampler(page.reader, 50.0, simulation_clock=False), []
    for wake in range(200):
        page.write_until(0.02 * wake)
        late_s = 0.008 if wake % 7 else 0.0
        found += sampler.due(unix_s + 0.02 * wake + late_s)
    errors = [truth.p_n[0, 0] - (time_s - unix_s) for time_s, truth in found[20:]]
    assert max(map(abs, errors)) < 0.015
