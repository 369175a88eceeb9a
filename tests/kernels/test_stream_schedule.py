"""Schedule of message streams: order, catching up, and equal results of the compiled and the interpreted kernel."""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAME = "stream_schedule"


@pytest.fixture(params=["compiled", "interpreted"])
def module(request: pytest.FixtureRequest) -> ModuleType:
    return {"compiled": compiled_modules, "interpreted": interpreted_modules}[request.param](NAME)[NAME]


def schedule_of(module: ModuleType, links: int = 2) -> Any:
    return module.StreamSchedule(links, memoryview(np.array([1, 30, 32, 33])))


def test_due_messages_come_in_the_order_of_their_times_then_of_their_ids(module):
    schedule = schedule_of(module)
    for column, first_s in ((3, 0.1), (1, 0.3), (0, 0.2), (2, 0.2)):
        schedule.set_interval(1, column, 1.0, first_s)
    assert schedule.take_due(1, 0.05) == [] and not schedule.is_any_due(0, 2, 0.05)
    assert schedule.take_due(1, 0.35) == [3, 0, 2, 1]
    assert schedule.take_due(1, 1.1) == [3] and schedule.take_due(0, 9.0) == []


def test_a_period_is_kept_without_drift(module):
    schedule = schedule_of(module)
    schedule.set_interval(0, 1, 0.01, 0.0)
    sent = sum(len(schedule.take_due(0, 0.004 * step)) for step in range(2501))
    assert sent == 1001


def test_a_late_stream_skips_old_messages(module):
    schedule = schedule_of(module)
    schedule.set_interval(0, 1, 0.01, 0.0)
    assert len(schedule.take_due(0, 5.0)) == 12  # the first one, and those of the last 0.1 s
    assert schedule.next_s[0] == pytest.approx(5.01)


def test_slower_messages_share_the_datagrams_of_the_fastest_stream(module):
    schedule = schedule_of(module)
    rates = {1: 100.0, 2: 50.0, 0: 30.0, 3: 10.0}
    for column, hz in rates.items():
        schedule.set_interval(0, column, 1.0 / hz, 0.0)
    sent = {column: [] for column in rates}
    datagrams = 0
    for step in range(2500):
        now = 0.004 * step
        if schedule.is_due(0, now):
            datagrams += 1
            for column in schedule.take_due(0, now):
                sent[column].append(now)
    assert datagrams == 1000, "those of the stream with 100 Hz"
    for column, hz in rates.items():
        late_s = np.array(sent[column]) - np.arange(10 * hz) / hz
        assert late_s.min() > -1e-6 and late_s.max() < 0.008 + 0.004


def test_a_waiting_message_is_not_taken_before_that_of_the_faster_stream(module):
    schedule = schedule_of(module)
    schedule.set_interval(0, 1, 0.01, 0.108)
    schedule.set_interval(0, 2, 0.02, 0.1)
    assert not schedule.is_due(0, 0.104) and schedule.take_due(0, 0.104) == []
    assert schedule.take_due(0, 0.108) == [2, 1]


def test_a_message_does_not_wait_for_a_slower_stream(module):
    schedule = schedule_of(module)
    schedule.set_interval(0, 1, 0.01, 0.1)
    schedule.set_interval(0, 2, 0.02, 0.104)
    assert schedule.next_s[0] == 0.1


def test_a_stopped_stream_is_not_due(module):
    schedule = schedule_of(module)
    schedule.set_interval(0, 1, 0.01, 0.0)
    schedule.set_interval(0, 1, 0.0, 0.0)
    assert schedule.take_due(0, 5.0) == [] and schedule.next_s[0] == math.inf


@needs_compiled
def test_compiled_and_interpreted_schedule_agree():
    def run(module: ModuleType) -> list[Any]:
        rng, schedule, seen = np.random.default_rng(3), schedule_of(module, 3), []
        for step in range(500):
            link, column = int(rng.integers(3)), int(rng.integers(4))
            now = 0.004 * step
            if rng.random() < 0.2:
                schedule.set_interval(link, column, float(rng.choice([0.0, 0.004, 0.01, 0.3])), now)
            seen.append(schedule.take_due(link, now))
        return [*seen, np.asarray(schedule.due_s).tolist(), np.asarray(schedule.next_s).tolist()]

    assert run(compiled_modules(NAME)[NAME]) == run(interpreted_modules(NAME)[NAME])
