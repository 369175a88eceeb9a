"""Pacing is pure: absolute deadlines, forgiven debts, percentiles in bounded memory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.sim.pacing import Lateness, Pacer, own_core, speed_of

P = 0.004


def test_deadlines_are_absolute_so_small_lateness_does_not_add_up():
    pacer = Pacer(period_s=P, speed=1.0, now=100.0)
    for k in range(1, 1001):
        due = 100.0 + k * P
        assert pacer.wait_s(due) == pytest.approx(0.0, abs=1e-9)
        pacer.begin(due + 0.001)
    assert pacer.forgiven == 0
    assert pacer.lateness.worst_s == pytest.approx(0.001)


def test_a_debt_up_to_twenty_milliseconds_is_caught_up():
    pacer = Pacer(period_s=P, speed=1.0, now=0.0)
    pacer.begin(P + 0.018)
    assert pacer.forgiven == 0
    assert pacer.wait_s(P + 0.018) == pytest.approx(P - 0.018)


def test_a_greater_debt_is_forgiven_and_counted_and_no_rush_follows():
    pacer = Pacer(period_s=P, speed=1.0, now=0.0)
    pacer.begin(P + 0.5)
    assert (pacer.forgiven, pacer.forgiven_s) == (1, pytest.approx(0.5))
    assert pacer.wait_s(P + 0.5) == pytest.approx(P)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_speed_scales_the_wall_time_of_a_step_and_is_what_the_factor_shows(speed):
    pacer, now = Pacer(period_s=P, speed=speed, now=0.0), 0.0
    for _ in range(int(3.1 * speed / P)):
        now += pacer.wait_s(now)
        pacer.begin(now)
    assert pacer.rtf == pytest.approx(speed, rel=0.01)
    assert pacer.rtf_min == pytest.approx(speed, rel=0.01)


def test_at_most_speed_it_never_waits_and_nothing_is_late():
    pacer = Pacer(period_s=P, speed=speed_of("max"), now=5.0)
    for k in range(3000):
        assert pacer.wait_s(5.0 + k * 0.0005) <= 0.0
        pacer.begin(5.0 + k * 0.0005)
    assert pacer.rtf == pytest.approx(8.0, rel=0.01)
    assert (pacer.lateness.steps, pacer.forgiven) == (0, 0)


def test_a_stall_shows_in_the_least_factor():
    pacer, now = Pacer(period_s=P, speed=1.0, now=0.0), 0.0
    for k in range(1000):
        now += max(0.0, pacer.wait_s(now)) + (0.3 if k == 400 else 0.0)
        pacer.begin(now)
    assert pacer.rtf_min == pytest.approx(0.7, abs=0.03)
    assert pacer.rtf == pytest.approx(1.0, abs=0.01)


def test_stats_are_json_before_the_first_second():
    stats = Pacer(period_s=P, speed=1.0, now=0.0).stats()
    assert stats["rtf"] is None and stats["lateness_p99_ms"] == 0.0


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


def test_a_world_that_hurries_keeps_to_a_core_where_every_px4_has_one_too():
    assert own_core((3, 2), speed=math.inf, outside=1, pid=10) == 2
    assert own_core((3, 2), speed=5.0, outside=1, pid=11) == 3, "another world beside it takes the other"
    assert own_core(tuple(range(8)), speed=math.inf, outside=7, pid=0) == 0


@pytest.mark.parametrize(
    ("speed", "outside", "cores"), [(1.0, 1, 2), (math.inf, 0, 2), (math.inf, 2, 2), (math.inf, 1, 1)]
)
def test_else_the_kernel_chooses(speed, outside, cores):
    assert own_core(tuple(range(cores)), speed=speed, outside=outside, pid=7) is None
