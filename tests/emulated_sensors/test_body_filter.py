"""Velocity of a body from captured positions: noise, delay, gaps."""

from __future__ import annotations

import numpy as np
import pytest

from arena.emulated_sensors.body_filter import SETTLING_FRAMES, BodyFilter, steady_gains
from arena.geometry import Array

FRAME_S = 1 / 180


def filtered(p_n: Array, noise_m: float, first_s: float = 50.0) -> Array:
    """Return the velocities [m/s] (m, 3) that a filter computes from positions [m] (n, 3) with noise."""
    random = np.random.default_rng(3)
    one = BodyFilter(steady_gains(noise_m, FRAME_S))
    found = []
    for k, p in enumerate(p_n + random.normal(0.0, noise_m, p_n.shape)):
        motion = one.add((p[0], p[1], p[2]), first_s + k * FRAME_S)
        if motion is not None:
            assert motion.p_n == tuple(p)
            found.append(motion.v_n)
    return np.array(found)


def test_velocity_of_a_circle_has_centimetres_per_second_of_noise_and_little_delay() -> None:
    t = np.arange(0.0, 20.0, FRAME_S)
    w, r = 0.5, 1.5  # the formation of the thesis: 0.75 m/s
    p = np.stack([r * np.cos(w * t), -r * np.sin(w * t), -1.25 + 0.0 * t], axis=1)
    v = np.stack([-w * r * np.sin(w * t), -w * r * np.cos(w * t), 0.0 * t], axis=1)
    error = filtered(p, 3e-4)[200:] - v[SETTLING_FRAMES - 1 :][200:]
    assert np.sqrt((error**2).mean()) < 0.01
    assert np.abs(error.mean(axis=0)).max() < 0.003


def test_velocity_is_not_given_before_the_filter_has_settled() -> None:
    p = np.zeros((SETTLING_FRAMES - 1, 3))
    assert filtered(p, 3e-4).size == 0


@pytest.mark.parametrize("gap_s", [0.2, -1.0, 0.0])
def test_filter_starts_again_after_a_gap_or_a_restart_of_the_clock(gap_s: float) -> None:
    one = BodyFilter(steady_gains(3e-4, FRAME_S))
    last_s = 0.0
    for k in range(100):
        last_s = k * FRAME_S
        one.add((k * 0.01, 0.0, 0.0), last_s)
    for k in range(SETTLING_FRAMES - 1):
        assert one.add((9.0, 0.0, 0.0), last_s + gap_s + k * FRAME_S) is None
    motion = one.add((9.0, 0.0, 0.0), last_s + gap_s + (SETTLING_FRAMES - 1) * FRAME_S)
    assert motion is not None and motion.v_n == (0.0, 0.0, 0.0)


def test_lost_frames_do_not_change_the_velocity() -> None:
    one = BodyFilter(steady_gains(3e-4, FRAME_S))
    motion = None
    for k in range(300):
        if k % 7:
            motion = one.add((0.8 * k * FRAME_S, -0.4 * k * FRAME_S, 0.0), k * FRAME_S)
    assert motion is not None and motion.v_n == pytest.approx((0.8, -0.4, 0.0), abs=1e-3)
