"""Values of measured quantities at the times of rows."""

from __future__ import annotations

import numpy as np
import pytest

from arena.flight_log import resample
from arena.geometry import euler_from_quat, quat_from_euler

T = np.array([1.0, 1.1, 1.2])
VALUES = np.array([[0.0], [10.0], [20.0]])


def test_value_between_two_samples_is_interpolated():
    assert resample.linear(T, VALUES, np.array([1.025]))[0] == pytest.approx([2.5])


def test_value_at_a_sample_is_the_sample():
    assert resample.linear(T, VALUES, T).tolist() == VALUES.tolist()


def test_nothing_is_extrapolated():
    assert np.isnan(resample.linear(T, VALUES, np.array([0.99, 1.21]))).all()
    assert np.isnan(resample.linear(np.zeros(0), np.zeros((0, 1)), T)).all()


def test_long_gap_is_not_interpolated():
    t = np.array([1.0, 1.0 + resample.MAX_GAP_S + 0.01])
    found = resample.linear(t, VALUES[:2], np.array([1.0, 1.2, t[1]]))[:, 0]
    assert np.isnan(found).tolist() == [False, True, False]


def test_sample_that_is_not_newer_is_dropped():
    assert resample.advancing(np.array([1.0, 1.0, 0.5, 1.1])).tolist() == [True, False, False, True]
    assert resample.advancing(np.zeros(0)).tolist() == []


@pytest.mark.parametrize("at", [0.0, 0.01, 0.2, 0.3])
def test_constant_acceleration_is_interpolated_exactly(at: float):
    def state(t: float) -> np.ndarray:
        p0, v0, a = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.0, -1.0]), np.array([4.0, -9.0, 2.0])
        return np.concatenate([p0 + v0 * t + a * t * t / 2, v0 + a * t])

    times = np.array([0.0, 0.3])
    found = resample.position_velocity(times, np.stack([state(0.0), state(0.3)]), np.array([at]))
    assert found[0] == pytest.approx(state(at), abs=1e-12)


def test_attitude_turns_at_a_constant_rate_the_shorter_way():
    a, b = quat_from_euler([0.1, -0.3, 3.0]), quat_from_euler([0.1, -0.3, 3.4])
    values = np.stack([[*a, 0.0], [*(-b), 1.0]])
    found = resample.attitude(np.array([1.0, 1.02]), values, np.array([1.005]))[0]
    assert euler_from_quat(found[:4]) == pytest.approx([0.1, -0.3, 3.1]) and found[4] == pytest.approx(0.25)


def test_held_value_lasts_until_the_next_one_or_its_limit():
    at = np.array([0.9, 1.0, 1.49, 1.5, 3.5, 3.6])
    index, valid = resample.held(np.array([1.0, 1.5]), at, 2.0)
    assert valid.tolist() == [False, True, True, True, True, False]
    assert index[valid].tolist() == [0, 0, 1, 1]


def test_last_received_value_counts_when_time_stamps_go_back():
    index, valid = resample.held(np.array([1.0, 1.5, 1.2]), np.array([1.1, 1.3, 2.0]), 2.0)
    assert index.tolist() == [0, 2, 2] and valid.all()


def test_simulated_stamps_are_the_time_of_the_log():
    t = np.array([1.0, 1.1])
    assert resample.sender_times(t, t + 0.012).tolist() == t.tolist()


def test_offset_is_the_smallest_delay():
    found = resample.sender_times(np.array([100.0, 100.1, 100.2]), np.array([250.02, 250.1, 250.29]))
    assert found[2] == pytest.approx(250.2, abs=1e-4)


def test_one_datagram_that_was_stamped_too_early_moves_no_other_message():
    t = np.arange(0.0, 2.0, 0.1)
    received = t + 0.004
    received[5] -= (
        0.22  # the world had stood still: the stamp is before the time at which the message was sent
    )
    assert resample.sender_times(t, received).tolist() == t.tolist()


def test_restarted_sender_gets_a_new_offset():
    found = resample.sender_times(np.array([100.0, 1.0, 1.1]), np.array([250.0, 260.0, 260.1]))
    assert found[1:] == pytest.approx([260.0, 260.1], abs=1e-4)


def test_stamp_that_stands_still_is_replaced_by_the_time_of_reception():
    received = 250.0 + np.arange(3)
    assert resample.sender_times(np.zeros(3), received) == pytest.approx(received)


def test_slow_drift_of_the_senders_clock_is_followed():
    k = np.arange(6000)  # 10 minutes; the sender's clock loses 20 ppm
    found = resample.sender_times(100.0 + k * 0.1 * (1 - 20e-6), 250.0 + k * 0.1)
    assert found[-1] == pytest.approx(250.0 + 5999 * 0.1, abs=1e-3)


def one_by_one(stamps: np.ndarray, received: np.ndarray) -> list[float]:
    """The same times, computed one after the other."""
    found, least, before, newest = [], np.inf, None, -np.inf
    for stamp, at in zip(stamps.tolist(), received.tolist(), strict=True):
        if stamp == before:
            found.append(at)
            continue
        before, delay, allowed = stamp, at - stamp, least + 5e-5 * (at - newest)
        restarted = abs(delay - allowed) > 1.0
        least, newest = (delay if restarted or delay < allowed else allowed), at
        found.append(stamp + (0.0 if abs(least) < 0.05 else least))
    return found


def test_reboots_and_stalls_give_the_same_times_in_blocks_and_one_by_one():
    rng = np.random.default_rng(1)
    stamps = 100.0 + np.cumsum(rng.choice([0.0, 0.02, 0.02, 0.02], 9000))
    received = 250.0 + stamps * (1 + 3e-5) + rng.exponential(0.005, 9000)
    stamps[5000:] -= 60.0  # a reboot
    received[7000:] += 3.0  # a stall of the link
    assert resample.sender_times(stamps, received) == pytest.approx(one_by_one(stamps, received), abs=1e-6)
