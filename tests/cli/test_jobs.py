"""Number of flights that `arena smoke` flies at the same time."""

from __future__ import annotations

import os

import pytest

from arena.cli.smoke import _jobs

CORES = len(os.sched_getaffinity(0))


@pytest.mark.parametrize(
    ("jobs", "speed", "expected"),
    [(None, "max", CORES + 1), (None, "1", CORES), (None, "4", CORES), (1, "max", 1), (5, "1", 5)],
)
def test_flights_at_the_same_time(jobs, speed, expected):
    assert _jobs(jobs, speed) == expected
