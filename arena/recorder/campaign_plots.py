"""Plots of a campaign: one measure of all flights, over each varied setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from arena.geometry import Array

_DPI = 90
_GOOD, _BAD = "tab:blue", "tab:red"
_COLUMNS = 3
_MOST_TICKS = 12


def draw(
    title: str,
    label: str,
    values: Array,
    passed: Sequence[bool],
    settings: Mapping[str, Sequence[object]],
    path: Path,
) -> Path:
    """Write the plot of one measure to `path` and return `path`: one panel per setting, and a histogram.

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
    known = values[np.isfinite(values)]
    histogram.hist(known, bins=min(30, max(5, int(np.sqrt(known.size)))), color=_GOOD)
    histogram.set(xlabel=label, ylabel="flights")
    for panel in axes[panels:]:
        panel.set_visible(False)
    for panel in axes[:panels]:
        panel.grid(alpha=0.3)
    figure.suptitle(_plain(title))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=_DPI)
    return path


def _over_setting(panel: Axes, values: Array, passed: Array, given: Sequence[object]) -> None:
    """Plot a point per flight over the values of a setting. If values repeat, plot the line of the medians, too."""
    numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in given)
    names = [str(v) for v in given]
    known = list(dict.fromkeys(names))
    x = np.array(given, float) if numeric else np.array([known.index(n) for n in names], float)
    for mask, colour, text in ((passed, _GOOD, "passed"), (np.logical_not(passed), _BAD, "failed")):
        if mask.any():
            panel.plot(x[mask], values[mask], ".", color=colour, alpha=0.6, label=text)
    places = np.unique(x)
    if places.size < x.size and numeric:
        middles = [_median(values[x == place]) for place in places]
        panel.plot(places, middles, color="black", linewidth=1.0, label="median")
    if not numeric and len(known) <= _MOST_TICKS:
        panel.set_xticks(range(len(known)), [_plain(n) for n in known])
    panel.legend(fontsize="small")


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _plain(text: str) -> str:
    """Return the text with `$` escaped, because matplotlib interprets `$` as the start of a formula."""
    return text.replace("$", r"\$")
