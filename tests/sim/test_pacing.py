"""Pacing: absolute deadlines, skipped delays, percentiles in bounded memory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.sim.pacing import Lateness, Pacer, own_core
from arena.simulation_speed import speed_of

P = 0.004


def test_deadlines_are_absolute():
    pacer = Pacer(period_s=P, speed=1.0, now=100.0)
    for k in range(1, 1001):
        due = 100.0 + k * P
        assert pacer.wait_s(due) == pytest.approx(0.0, abs=1e-9)
        pacer.begin(due + 0.001)
    assert pacer.skipped == 0
    assert pacer.lateness.worst_s == pytest.approx(0.001)


def test_a_delay_up_to_20_ms_is_caught_up():
    pacer = Pacer(period_s=P, speed=1.0, now=0.0)
    pacer.begin(P + 0.018)
    assert pacer.skipped == 0
    assert pacer.wait_s(P + 0.018) == pytest.approx(P - 0.018)


def test_a_longer_delay_is_skipped_and_counted():
    pacer = Pacer(period_s=P, speed=1.0, now=0.0)
    pacer.begin(P + 0.5)
    assert (pacer.skipped, pacer.skipped_s) == (1, pytest.approx(0.5))
    assert pacer.wait_s(P + 0.5) == pytest.approx(P)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_speed_scales_the_wall_time_of_a_step(speed):
    pacer, now = Pacer(period_s=P, speed=speed, now=0.0), 0.0
    for _ in range(int(3.1 * speed / P)):
        now += pacer.wait_s(now)
        pacer.begin(now)
    assert pacer.rtf == pytest.approx(speed, rel=0.01)
    assert pacer.rtf_min == pytest.approx(speed, rel=0.01)


def test_speed_max_never_waits_and_is_never_late():
    pacer = Pacer(period_s=P, speed=speed_of("max"), now=5.0)
    for k in range(3000):
        assert pacer.wait_s(5.0 + k * 0.0005) <= 0.0
        pacer.begin(5.0 + k * 0.0005)
    assert pacer.rtf == pytest.approx(8.0, rel=0.01)
    assert (pacer.lateness.steps, pacer.skipped) == (0, 0)


def test_a_stall_shows_in_the_minimum_real_time_factor():
    pacer, now = Pacer(period_s=P, speed=1.0, now=0.0), 0.0
    for k in range(1000):
        now += max(0.0, pacer.wait_s(now)) + (0.3 if k == 400 else 0.0)
        pacer.begin(now)
    assert pacer.rtf_min == pytest.approx(0.7, abs=0.03)
    assert pacer.rtf_min_sim_s == pytest.approx(400 * P, abs=1.0)
    assert pacer.stats()["rtf_min_sim_s"] == pytest.approx(pacer.rtf_min_sim_s, abs=1e-3)
    assert pacer.rtf == pytest.approx(1.0, abs=0.01)


def test_stats_are_json_before_the_first_second():
    stats = Pacer(period_s=P, speed=1.0, now=0.0).stats()
    assert stats["rtf"] is None and stats["rtf_min_sim_s"] is None and stats["lateness_p99_ms"] == 0.0


def test_percentiles_agree_with_numpy_within_a_bin():
    late = np.abs(np.random.default_rng(1).normal(0.0, 0.002, 20_000))
    lateness = Lateness()
    for x in late:
        lateness.add(float(x))
    for percent in (50, 99, 99.9):
        assert lateness.percentile(percent) == pytest.approx(np.percentile(late, percent), abs=2e-4)
    assert lateness.worst_s == late.max()


def test_percentiles_never_understate():
    lateness = Lateness()
    for _ in range(10):
        lateness.add(3.0)
    assert lateness.percentile(99) == 3.0
    assert not math.isnan(Lateness().percentile(99))


def test_a_fast_world_keeps_a_core_when_each_px4_has_one():
    assert own_core((3, 2), speed=math.inf, external=1, pid=10) == 2
    assert own_core((3, 2), speed=5.0, external=1, pid=11) == 3, "another world beside it takes the other"
    assert own_core(tuple(range(8)), speed=math.inf, external=7, pid=0) == 0


@pytest.mark.parametrize(
    ("speed", "outside", "cores"), [(1.0, 1, 2), (math.inf, 0, 2), (math.inf, 2, 2), (math.inf, 1, 1)]
)
def test_else_the_world_uses_all_cores(speed, outside, cores):
    assert own_core(tuple(range(cores)), speed=speed, external=outside, pid=7) is None
