"""Plots of a campaign: one measure of all its flights, against each varied setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from arena.geometry import Array

_DPI = 90
_GOOD, _BAD = "tab:blue", "tab:red"
_COLUMNS = 3
_MOST_TICKS = 12
_LONG_NAME = 10  # characters; longer names of values are turned, so that they do not overlap
_LOG_RATIO = 30.0  # largest to smallest value of a setting from which its axis is logarithmic


def draw(
    title: str,
    label: str,
    values: Array,
    passed: Sequence[bool],
    settings: Mapping[str, Sequence[object]],
    path: Path,
) -> Path:
    """Write the plot of one measure to a file and return its path.

    It has one panel per varied setting, and a histogram.

    label: axis label of the measure, with its unit.
    values: value of each flight (n,), NaN if unknown.  passed: whether each flight passed (n,).
    settings: setting -> its value in each flight (n,).
    """
    panels = len(settings) + 1
    rows = -(-panels // _COLUMNS)
    columns = min(panels, _COLUMNS)
    figure = Figure(figsize=(4.2 * columns, 0.6 + 3.4 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, (name, given) in zip(axes, settings.items(), strict=False):
        _over_setting(panel, values, np.array(passed, bool), given)
        panel.set(xlabel=_plain(name), ylabel=label)
    histogram = axes[len(settings)]
    _histogram(histogram, values, np.array(passed, bool))
    histogram.set(xlabel=label, ylabel="flights")
    for panel in axes[panels:]:
        panel.set_visible(False)
    for panel in axes[:panels]:
        panel.grid(alpha=0.3)
    figure.suptitle(_plain(title))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=_DPI)
    return path


def _histogram(panel: Axes, values: Array, passed: Array) -> None:
    """Plot a histogram of the measure. Failed flights are drawn on top of passed flights.

    A measure with few values, all integers, such as a number of collisions, gets one bar per integer.
    """
    known = np.isfinite(values)
    parts = [values[known & passed], values[known & np.logical_not(passed)]]
    if _whole(values[known]):
        panel.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        bins = np.arange(values[known].min() - 0.5, values[known].max() + 1.0)
    else:
        bins = np.histogram_bin_edges(values[known], min(30, max(5, int(np.sqrt(known.sum())))))
    panel.hist(parts, bins=list(bins), color=[_GOOD, _BAD], stacked=True)
    panel.yaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))


def _whole(values: Array) -> bool:
    """Return whether all values are integers in a narrow range, so that each can have a bar of its own."""
    return bool(values.size and np.all(values == np.round(values)) and np.ptp(values) < 30)


def _over_setting(panel: Axes, values: Array, passed: Array, given: Sequence[object]) -> None:
    """Plot the measure of each flight against one varied setting.

    If a value of the setting occurs in several flights, the median of these flights is plotted, too.
    """
    numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in given)
    names = [str(v) for v in given]
    known = list(dict.fromkeys(names))
    x = np.array(given, float) if numeric else np.array([known.index(n) for n in names], float)
    if passed.any():
        panel.plot(x[passed], values[passed], ".", color=_GOOD, alpha=0.6, label="passed")
    failed = np.logical_not(passed)
    if failed.any():
        panel.plot(x[failed], values[failed], "x", color=_BAD, markersize=7, zorder=3, label="failed")
    places = np.unique(x)
    if places.size < x.size:
        middles = [_median(values[x == place]) for place in places]
        style = "-" if numeric else "_"
        panel.plot(places, middles, style, color="black", linewidth=1.0, markersize=16, label="median")
    if numeric and places[0] > 0 and places[-1] >= _LOG_RATIO * places[0]:
        panel.set_xscale("log")
    if not numeric and len(known) <= _MOST_TICKS:
        panel.set_xticks(range(len(known)), [_plain(n) for n in known])
        if max(map(len, known)) > _LONG_NAME:
            for text in panel.get_xticklabels():
                text.set(rotation=20.0, ha="right")
        panel.margins(x=0.2)
    if _whole(values[np.isfinite(values)]):
        panel.yaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    panel.legend(fontsize="small")


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _plain(text: str) -> str:
    """Escape `$` in a text, because matplotlib interprets `$` as the start of a formula."""
    return text.replace("$", r"\$")
