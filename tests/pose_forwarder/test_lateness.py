"""Lateness of frames by two clocks with different zeros."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.pose_forwarder.lateness import Lateness

RATE = 180


def test_late_first_frame_is_not_the_reference():
    lateness = Lateness(0.1)
    assert lateness.measure(0.0, 0.08, True) == 0.0
    lateness.measure(1.0, 1.0, True)
    assert lateness.measure(2.0, 2.08, True) == pytest.approx(0.08, abs=0.001)


def test_clock_drift_over_an_hour_makes_no_frame_stale():
    lateness = Lateness(0.1)
    for drift in (1e-4, -1e-4):
        lateness.reset()
        assert max(lateness.measure(t * (1 + drift), t, True) for t in (k / 20 for k in range(72_000))) < 0.01


@given(st.lists(st.tuples(st.floats(), st.floats(0, 0.1)), max_size=40))
def test_prompt_frames_are_accepted_within_a_second_of_any_stamps(history):
    lateness, now = Lateness(0.1), 0.0
    for stamp, dt in history:
        now += dt
        lateness.measure(stamp, now, False)
    late = [lateness.measure(t, t, False) for t in (now + k / RATE for k in range(4 * RATE))]
    assert late[-1] <= 0.1
