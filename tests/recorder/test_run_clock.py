"""Conversion of monotonic times to the run's clock."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.recorder.run_clock import RunClock

times = st.floats(0.0, 1e6)


def test_time_between_two_readings_is_interpolated():
    clock = RunClock(5.0, 100.0)
    clock.update(25.0, 101.0)  # the simulation runs 20 times as fast as real time
    assert clock.at(100.25) == pytest.approx(10.0)


def test_time_outside_of_the_readings_is_that_of_the_nearest():
    clock = RunClock(5.0, 100.0)
    clock.update(6.0, 101.0)
    assert (clock.at(99.0), clock.at(102.0)) == (5.0, 6.0)


def test_only_the_last_two_readings_count():
    clock = RunClock(0.0, 0.0)
    clock.update(1.0, 10.0)
    clock.update(11.0, 20.0)
    assert clock.at(15.0) == pytest.approx(6.0)


def test_more_readings_convert_older_times():
    clock = RunClock(0.0, 0.0, readings=3)
    clock.update(1.0, 10.0)
    clock.update(11.0, 20.0)
    assert clock.at(5.0) == pytest.approx(0.5)
    clock.update(12.0, 30.0)
    assert [clock.at(5.0), clock.at(15.0), clock.at(25.0)] == pytest.approx([1.0, 6.0, 11.5])


@given(st.lists(st.tuples(times, times), min_size=1), times)
def test_result_is_never_outside_of_the_readings(readings, at):
    clock = RunClock(0.0, 0.0)
    run_s, monotonic_s = 0.0, 0.0
    for more_run_s, more_s in readings:
        before, run_s, monotonic_s = run_s, run_s + more_run_s, monotonic_s + more_s
        clock.update(run_s, monotonic_s)
        assert before <= clock.at(at) <= run_s
