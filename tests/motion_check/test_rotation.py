"""Delay and axes of captured motion, found from a gyroscope."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.geometry import quat_from_euler, quat_multiply
from arena.motion_check.rotation import captured_rates, compare, mean_rates


def attitude(t: float):
    return quat_from_euler([0.4 * math.sin(1.9 * t), 0.5 * math.sin(1.3 * t + 0.4), 0.6 * math.sin(0.8 * t)])


def rates(times):
    step = 1e-4
    found = []
    for t in times:
        q = quat_multiply(attitude(t) * np.array([1, -1, -1, -1]), attitude(t + step))
        found.append(2.0 * q[1:] / step * math.copysign(1.0, q[0]))
    return np.array(found)


@pytest.mark.parametrize("delay_s", [0.0, 0.012, 0.06, 0.15])
@pytest.mark.parametrize("imu_hz", [50.0, 100.0])
def test_delay_is_found_within_5_ms(delay_s, imu_hz):
    rng = np.random.default_rng(3)
    captured_t, imu_t = np.arange(0.0, 8.0, 1 / 180), np.arange(0.0, 8.0, 1 / imu_hz)
    noise = quat_from_euler(rng.normal(0.0, math.radians(0.05), (len(captured_t), 3)))
    q = quat_multiply(np.array([attitude(t - delay_s) for t in captured_t]), noise)
    gyro = rates(imu_t) + rng.normal(0.0, 0.01, (len(imu_t), 3))
    found = compare(captured_rates(captured_t, q), mean_rates(imu_t, gyro))
    assert found is not None and found.same_axes > 0.98
    assert found.delay_s == pytest.approx(delay_s, abs=0.005)


def test_turned_axes_are_measured():
    times = np.arange(0.0, 8.0, 1 / 100)
    axes = quat_from_euler([0.0, 0.0, math.radians(90.0)])
    q = np.array([quat_multiply(attitude(t), axes) for t in times])
    found = compare(captured_rates(times, q), mean_rates(times, rates(times)))
    assert found is not None and found.any_axes > 0.98 and found.same_axes < 0.6
    assert found.turned_deg == pytest.approx(90.0, abs=3.0)


def test_too_few_samples_give_no_result():
    times = np.arange(0.0, 0.3, 1 / 50)
    q = np.array([attitude(t) for t in times])
    assert compare(captured_rates(times, q), mean_rates(times, rates(times))) is None
