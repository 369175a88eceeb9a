"""Plots log columns over time: as a picture (matplotlib) or as an interactive page (plotly)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from arena.errors import InputError
from arena.flight_log.columns import FURTHER, THESIS, TRUTH, Group
from arena.flight_log.flight import Flight
from arena.geometry import Array

PICTURES, PAGES = (".png", ".svg", ".pdf"), (".html",)
_GROUPS = {group.name: group for group in THESIS + FURTHER + TRUTH}
_UNITS = {column: group.unit for group in _GROUPS.values() for column in group.columns}
_PANEL_INCHES, _WIDTH_INCHES = 2.3, 10.0
_COLORS = (
    "#2a6fbb", "#d1495b", "#3a9d5d", "#e0a030", "#7a5ba8", "#1f9ba5", "#8c564b", "#6b7280",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Line:
    """Plotted line: a log column of one vehicle.

    label: text in the legend.
    t: time [s] (n,).
    values: (n,).
    """

    label: str
    t: Array
    values: Array


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Lines that share the same axes of a plot.

    title: label of the vertical axis, with the unit.
    """

    title: str
    lines: Sequence[Line]


def panels(flights: Sequence[Flight], wanted: Sequence[str]) -> list[Panel]:
    """Return one panel of lines for each requested column or sum of columns.

    wanted: column (`ekf.pos.down`), quantity with all its columns (`ekf.pos`), or several of them in one panel, joined with `+`.
    Raises InputError, with similar names, if no flight has a column.
    """
    return [_panel(flights, text) for text in wanted]


def write_plot(path: Path, shown: Sequence[Panel], title: str) -> None:
    """Write a plot to a picture or page.

    path: .png, .svg, .pdf, or .html for a page that can be zoomed. Raises InputError for other names.
    """
    if path.suffix in PAGES:
        _write_page(path, shown, title)
    elif path.suffix in PICTURES:
        _write_picture(path, shown, title)
    else:
        expected = ", ".join((*PICTURES, *PAGES))
        raise InputError(
            f"{path}: got a name that ends with {path.suffix or 'nothing'}, expected one of {expected}"
        )


def _panel(flights: Sequence[Flight], text: str) -> Panel:
    names = [column for part in text.split("+") for column in _columns(flights, part)]
    lines = [
        Line(
            label=f"{flight.name} {name}" if len(flights) > 1 else name,
            t=flight.t,
            values=flight.numbers[name],
        )
        for flight in flights
        for name in names
        if name in flight.numbers
    ]
    units = sorted({unit for name in names if (unit := _UNITS.get(name, "-")) != "-"})
    return Panel(title=f"{text} [{', '.join(units)}]" if units else text, lines=lines)


def _columns(flights: Sequence[Flight], name: str) -> list[str]:
    """Return the log columns that a name stands for: the column of this name, or all columns of a quantity."""
    there = {column for flight in flights for column in flight.numbers}
    group: Group | None = _GROUPS.get(name)
    found = [name] if name in there else [c for c in (group.columns if group else ()) if c in there]
    if found:
        return found
    near = get_close_matches(name, [*_GROUPS, *sorted(there)], n=3, cutoff=0.5)
    hint = f" Similar names: {', '.join(near)}." if near else ""
    raise InputError(
        f"{', '.join(flight.name for flight in flights)}: no column {name!r}.{hint} docs/reference/log-columns.md lists all columns"
    )


def _write_picture(path: Path, shown: Sequence[Panel], title: str) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH_INCHES, 0.8 + _PANEL_INCHES * len(shown)), layout="constrained")
    all_axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(all_axes, shown, strict=True):
        for k, line in enumerate(panel.lines):
            axes.plot(line.t, line.values, label=line.label, lw=1.3, color=_COLORS[k % len(_COLORS)])
        if not any(np.isfinite(line.values).any() for line in panel.lines):
            axes.text(0.5, 0.5, "no values", ha="center", va="center", transform=axes.transAxes, color="gray")
        axes.set_ylabel(panel.title, fontsize=9)
        axes.grid(alpha=0.3, lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    all_axes[-1].set_xlabel("time since the first row [s]")
    figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    figure.savefig(path, dpi=120)


def _write_page(path: Path, shown: Sequence[Panel], title: str) -> None:
    from plotly.graph_objects import Figure, Scatter
    from plotly.subplots import make_subplots

    figure: Figure = make_subplots(rows=len(shown), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, panel in enumerate(shown, start=1):
        legend = "legend" if row == 1 else f"legend{row}"
        for k, line in enumerate(panel.lines):
            pen = {"color": _COLORS[k % len(_COLORS)], "width": 1.5}
            drawn = Scatter(x=line.t, y=line.values, name=line.label, line=pen, legend=legend)
            figure.add_trace(drawn, row=row, col=1)
        figure.update_yaxes(title_text=panel.title, row=row, col=1)
        top = figure.layout["yaxis" if row == 1 else f"yaxis{row}"].domain[1]
        figure.update_layout({legend: {"y": top, "yanchor": "top"}})
    figure.update_xaxes(title_text="time since the first row [s]", row=len(shown), col=1)
    figure.update_layout(
        title=title, template="plotly_white", height=120 + 260 * len(shown), hovermode="x unified"
    )
    figure.write_html(path, include_plotlyjs=True)
