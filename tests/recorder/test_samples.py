"""Histories of samples and their value at an instant."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.geometry import euler_from_quat, quat_from_euler
from arena.recorder.samples import MAX_GAP_S, Held, SenderClock, Series, leading_quaternion, position_velocity


def series(*samples: tuple[float, float]) -> Series:
    made = Series()
    for time_s, value in samples:
        made.add(time_s, (value,))
    return made


def test_value_between_two_samples_is_interpolated():
    assert series((1.0, 0.0), (1.1, 10.0)).at(1.025) == pytest.approx([2.5])


def test_value_at_a_sample_is_the_sample():
    made = series((1.0, 3.0), (1.1, 4.0))
    assert made.at(1.0) == (3.0,) and made.at(1.1) == (4.0,)


def test_nothing_is_extrapolated():
    made = series((1.0, 3.0), (1.1, 4.0))
    assert made.at(0.99) is None and made.at(1.11) is None and Series().at(1.0) is None


def test_long_gap_is_not_interpolated():
    assert series((1.0, 3.0), (1.0 + MAX_GAP_S + 0.01, 4.0)).at(1.2) is None


def test_sample_that_is_not_newer_is_dropped():
    assert series((1.0, 3.0), (1.0, 9.0), (0.5, 9.0), (1.1, 4.0)).at(1.0) == (3.0,)


def test_live_stream_is_waited_for_and_dead_one_is_not():
    made = series((1.0, 3.0))
    assert made.waits_for(1.01) and not made.waits_for(1.0) and not made.waits_for(1.0 + MAX_GAP_S + 0.01)
    assert not Series().waits_for(1.0)


@given(st.floats(0.0, 1.0), st.floats(0.01, 0.5))
def test_constant_acceleration_is_interpolated_exactly(u: float, span: float):
    def at(t: float) -> np.ndarray:
        p0, v0, a = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.0, -1.0]), np.array([4.0, -9.0, 2.0])
        return np.concatenate([p0 + v0 * t + a * t * t / 2, v0 + a * t])

    assert position_velocity(at(0.0), at(span), u, span) == pytest.approx(at(u * span), abs=1e-12)


def test_attitude_turns_at_a_constant_rate():
    a, b = quat_from_euler([0.1, -0.3, 3.0]), quat_from_euler([0.1, -0.3, 3.4])
    found = leading_quaternion((*a.tolist(), 0.0), (*(-b).tolist(), 1.0), 0.25, 0.02)
    assert euler_from_quat(found[:4]) == pytest.approx([0.1, -0.3, 3.1]) and found[4] == 0.25


def test_held_value_lasts_until_the_next_one_or_its_limit():
    held = Held[str](2.0)
    assert held.at(1.0) is None
    held.add(1.0, "a")
    held.add(1.5, "b")
    assert [held.at(t) for t in (0.9, 1.0, 1.49, 1.5, 3.5, 3.6)] == [None, "a", "a", "b", "b", None]


def test_simulated_stamps_are_local_time():
    clock = SenderClock()
    assert [clock.local(t, t + 0.012) for t in (1.0, 1.1)] == [1.0, 1.1]


def test_offset_is_the_smallest_delay():
    clock = SenderClock()
    clock.local(100.0, 250.02)
    clock.local(100.1, 250.1)
    assert clock.local(100.2, 250.29) == pytest.approx(250.2, abs=1e-4)


def test_restarted_sender_gets_a_new_offset():
    clock = SenderClock()
    clock.local(100.0, 250.0)
    assert clock.local(1.0, 260.0) == pytest.approx(260.0)


def test_stamp_that_stands_still_is_replaced_by_the_time_of_reception():
    clock = SenderClock()
    assert [clock.local(0.0, 250.0 + k) for k in range(3)] == pytest.approx([250.0, 251.0, 252.0])


def test_slow_drift_of_the_senders_clock_is_followed():
    clock = SenderClock()
    for k in range(6000):  # 10 minutes; the sender's clock loses 20 ppm
        found = clock.local(100.0 + k * 0.1 * (1 - 20e-6), 250.0 + k * 0.1)
    assert found == pytest.approx(250.0 + 5999 * 0.1, abs=1e-3)
