"""How often the recorder wakes."""

from __future__ import annotations

import pytest

from arena.recorder.run_time import wake_period_s


@pytest.mark.parametrize(("vehicles", "period_s"), [(1, 0.1), (2, 0.1), (4, 0.05), (5, 0.04), (50, 0.04)])
def test_more_vehicles_wake_the_recorder_more_often(vehicles, period_s):
    assert wake_period_s(vehicles, live=False) == pytest.approx(period_s)


def test_a_live_viewer_gets_messages_25_times_a_second():
    assert wake_period_s(1, live=True) == pytest.approx(0.04)
