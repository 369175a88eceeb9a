"""Plot of a smoke flight: height, distance and flight mode of every vehicle over time, with marks at the steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from arena.geometry import Array

_DPI = 90
_GOOD, _BAD = "tab:green", "tab:red"


@dataclass(frozen=True, kw_only=True)
class Track:
    """The plotted values of one vehicle.

    t: simulation time [s] (n,).
    height: height of the lowest point above the floor [m] (n,).
    distance: distance to the nearest other vehicle, or, with one vehicle only, to its start [m] (n,); NaN if unknown.
    modes: flight modes (n,), "" if unknown.
    """

    t: Array
    height: Array
    distance: Array
    modes: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Mark:
    """Vertical line in the plot for one step of the scenario. at_s: simulation time of the step [s]. good: whether the step has passed."""

    at_s: float
    text: str
    good: bool = True


def draw(title: str, tracks: Mapping[str, Track], marks: Sequence[Mark], path: Path) -> Path:
    """Write the plot of a smoke flight to `path` and return `path`.

    Each step of the scenario is a numbered vertical line. The texts of the steps are listed below the plot.
    """
    figure = Figure(figsize=(9, 7.5 + 0.17 * len(marks)), layout="constrained")
    above, middle, below = figure.subplots(3, 1, sharex=True)
    known = list(dict.fromkeys(mode for track in tracks.values() for mode in track.modes if mode))
    for i, (name, track) in enumerate(tracks.items()):
        colour, shift = f"C{i % 10}", 0.06 * (i - (len(tracks) - 1) / 2.0)
        above.plot(track.t, track.height, color=colour, linewidth=1.0, label=name)
        middle.plot(track.t, track.distance, color=colour, linewidth=1.0)
        rows = np.array([known.index(mode) + shift if mode else np.nan for mode in track.modes])
        below.plot(track.t, rows, color=colour, linewidth=2.0, drawstyle="steps-post")
    above.set_ylabel("height [m]")
    middle.set_ylabel("to the nearest [m]" if len(tracks) > 1 else "from its start [m]")
    below.set_yticks(range(len(known)), known)
    below.set_xlabel("simulation time [s]")
    for axes in (above, middle, below):
        axes.grid(alpha=0.3)
        for mark in marks:
            axes.axvline(mark.at_s, color=_GOOD if mark.good else _BAD, linestyle="--", linewidth=0.9)
    for number, mark in enumerate(marks, start=1):
        place = (mark.at_s, 1.0 + 0.07 * ((number - 1) % 2))
        above.annotate(
            str(number), place, xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize="small"
        )
    above.legend(loc="upper right", ncols=min(len(tracks), 5), fontsize="small")
    named = [
        f"{n}  {m.at_s:.2f} s  {'' if m.good else 'FAILED  '}{m.text}" for n, m in enumerate(marks, start=1)
    ]
    figure.suptitle(_plain(title))
    figure.supxlabel(_plain("\n".join(named)), x=0.02, ha="left", fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=_DPI)
    return path


def _plain(text: str) -> str:
    """Return the text with `$` escaped, because matplotlib interprets `$` as the start of a formula."""
    return text.replace("$", r"\$")
