"""Plots of campaigns: what one panel and the histogram show."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from arena.report import campaign_plots

Panels = Callable[..., list[Axes]]


@pytest.fixture
def panels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Panels:
    """Draw a plot and return its panels."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **more: drawn.append(self))

    def draw(values: list[float], passed: list[bool], **settings: list[object]) -> list[Axes]:
        campaign_plots.draw("title", "measure", np.array(values), passed, settings, tmp_path / "plot.png")
        return drawn[-1].axes

    return draw


def test_setting_over_decades_has_a_logarithmic_axis(panels: Panels) -> None:
    axes = panels([1.5, 2.5, 3.5], [True] * 3, noise=[0.1, 1.0, 10.0], mass=[1.0, 1.5, 2.0])
    assert [axis.get_xscale() for axis in axes[:2]] == ["log", "linear"]


def test_failed_flights_have_their_own_marker_and_bars(panels: Panels) -> None:
    panel, histogram = panels([1.5, 2.5, 9.5], [True, True, False], mass=[1.0, 1.5, 2.0])
    marks = {line.get_label(): line.get_marker() for line in panel.lines}
    assert marks == {"passed": ".", "failed": "x"}
    heights = [sum(bar.get_height() for bar in bars) for bars in histogram.containers]
    assert heights == [2, 1]


def test_values_that_are_texts_have_medians(panels: Panels) -> None:
    panel = panels([1.5, 2.5, 3.5, 5.5], [True] * 4, pilot=["slow", "slow", "fast", "fast"])[0]
    (median,) = (line for line in panel.lines if line.get_label() == "median")
    assert list(median.get_ydata()) == [2.0, 4.5]


def test_counts_have_one_bar_per_integer(panels: Panels) -> None:
    histogram = panels([0.0, 0.0, 2.0], [True, True, False], mass=[1.0, 1.5, 2.0])[1]
    assert {bar.get_x() + bar.get_width() / 2 for bars in histogram.containers for bar in bars} == {0, 1, 2}
