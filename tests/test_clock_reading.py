"""Two clocks are read at the same instant, also on a busy computer."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from arena import clock_reading
from arena.clock_reading import read_together


def interrupted(times: int) -> Callable[[], float]:
    """Return Unix time as a clock during whose first readings another process ran for 50 ms before and after."""
    left = [times]

    def clock() -> float:
        long = left[0] > 0
        left[0] -= 1
        if long:
            time.sleep(0.05)
        found = time.time()
        if long:
            time.sleep(0.05)
        return found + (1000.0 if long else 0.0)  # such a reading is recognised

    return clock


@pytest.mark.parametrize("times", [0, 1, 3])
def test_two_clocks_are_read_again_after_an_interruption(times):
    unix_s, monotonic_s = read_together(interrupted(times))
    assert unix_s - monotonic_s == pytest.approx(time.time() - time.monotonic(), abs=100.0)


def test_interrupted_readings_give_the_closest_pair(monkeypatch):
    stamps = iter([0.0, 0.5, 1.0, 1.1, 2.0, 2.4, 3.0, 3.6, 4.0, 4.2])
    monkeypatch.setattr(clock_reading.time, "monotonic", lambda: next(stamps))
    readings = iter([10.0, 11.0, 12.0, 13.0, 14.0])
    assert read_together(lambda: next(readings)) == (11.0, pytest.approx(1.05))
