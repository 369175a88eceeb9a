"""Figures of communication and processes: message rates, pose delays, CPU time and memory. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.geometry import Array
from arena.report.figures import Drawn, Figure, plain, time_layout
from arena.report.link_record import LinkRecord, rate_over_time
from arena.report.run_data import Load

_MOST_PROCESSES, _MOST_LINES = 24, 12
_PROCESS_COLOURS = (
    "#37474f", "#8d6e63", "#9e9d24", "#7e57c2", "#00838f", "#ad1457", "#546e7a", "#5d4037", "#827717", "#4527a0", "#006064", "#880e4f",
)  # fmt: skip
"""Colours of processes, which differ from those of vehicles."""


def links_figure(vehicles: Sequence[Drawn], links: Mapping[str, LinkRecord]) -> Figure:
    """Return the figure of the link traffic: datagrams from and to the vehicles, poses, and pose age."""
    data: list[dict[str, Any]] = []
    for one in vehicles:
        link = links.get(one.name)
        if link is None:
            continue
        for axis, stamps, label in (
            ("y", link.down_s, "from the vehicle"),
            ("y2", link.up_s, "to the vehicle"),
            ("y3", link.pose_s, "poses received"),
            ("y4", link.vision_s, "poses logged by the autopilot"),
        ):
            x, y = rate_over_time(stamps, float(one.t[-1]), 0.5)
            data += _trace(one, axis, x, y, label, ".1f") if x.size else []
        if link.pose_s.size:
            x, y = _worst_per_bin(link.pose_s, 1e3 * link.pose_age_s)
            data += _trace(one, "y5", x, y, "longest age", ".1f")
    titles = [
        "from<br>vehicle [1/s]",
        "to<br>vehicle [1/s]",
        "poses<br>received [1/s]",
        "poses at the<br>autopilot [1/s]",
        "pose age [ms]",
    ]
    return {"data": data, "layout": time_layout(titles, 110, zero=[True] * 5)}


def _trace(one: Drawn, axis: str, x: Array, y: Array, label: str, digits: str) -> list[dict[str, Any]]:
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "x": x,
            "y": y,
            "yaxis": axis,
            "name": plain(f"{one.name} {label}"),
            "showlegend": False,
            "line": {"color": one.colour, "width": 1.4, "shape": "hvh"},
            "hovertemplate": f"%{{y:{digits}}}<extra>{plain(one.name)} {label}</extra>",
            "meta": {"vehicle": one.chip or one.name, "curve": label},
        }
    ]


def _worst_per_bin(stamps: Array, values: Array, width_s: float = 0.5) -> tuple[Array, Array]:
    """Return the centres of time bins [s] (m,) and the largest value in each bin (m,). Empty bins give NaN."""
    first = float(stamps.min())
    index = ((stamps - first) / width_s).astype(int)
    worst = np.full(int(index.max()) + 1, -np.inf)
    np.maximum.at(worst, index, values)
    worst[np.isinf(worst)] = np.nan
    return first + width_s * (np.arange(worst.size, dtype=np.float64) + 0.5), worst


def loads_figure(loads: Mapping[str, Load]) -> Figure | None:
    """Return the figure of CPU load and memory of the processes over time, or None without measurements.

    loads: process -> CPU load and memory. The processes with the largest load are drawn.
    """
    largest = sorted(loads, key=lambda name: -float(loads[name].cpu.mean()))[:_MOST_LINES]
    if not largest:
        return None
    data: list[dict[str, Any]] = []
    for k, name in enumerate(largest):
        load = loads[name]
        alive = load.rss_mb > 0.0  # the last row of a process that has ended has no memory
        cpu, memory = np.where(alive, 100.0 * load.cpu, np.nan), np.where(alive, load.rss_mb, np.nan)
        for axis, values, unit in (("y", cpu, "%"), ("y2", memory, "MB")):
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": load.t,
                    "y": values,
                    "yaxis": axis,
                    "name": plain(name),
                    "legendgroup": plain(name),
                    "showlegend": axis == "y",
                    "line": {"color": _PROCESS_COLOURS[k % len(_PROCESS_COLOURS)], "width": 1.4},
                    "hovertemplate": f"%{{y:.1f}} {unit}<extra>{plain(name)}</extra>",
                }
            )
    return {
        "data": data,
        "layout": time_layout(["CPU load<br>[% of a core]", "memory<br>[MB]"], 190, zero=[True] * 2),
    }


def processes_figure(processes: Mapping[str, Mapping[str, Any]]) -> Figure | None:
    """Return the figure of the processes' mean CPU load and peak memory, or None without measurements.

    processes: process -> row of outcome.json. Parts of another process, which have no numbers of their own, are left out.
    """
    own = {
        name: row
        for name, row in processes.items()
        if not row.get("member_of") and row.get("cpu_mean") is not None
    }
    own = dict(sorted(own.items(), key=lambda item: -(item[1].get("cpu_mean") or 0.0))[:_MOST_PROCESSES])
    if not own:
        return None
    names = [plain(name) for name in own]
    cpu = [round(100.0 * (row.get("cpu_mean") or 0.0), 2) for row in own.values()]
    memory = [row.get("rss_peak_mb") or 0.0 for row in own.values()]
    bar = {"type": "bar", "orientation": "h", "y": names, "showlegend": False, "cliponaxis": False}
    axis = {"gridcolor": "#e6e9ee", "zeroline": False, "rangemode": "tozero", "fixedrange": True}
    data = [
        {**bar, "x": cpu, "text": [f"{v:.1f} %" for v in cpu], "textposition": "auto", "marker": {"color": "#4c8fd6"},
         "hovertemplate": "%{y}: %{x:.1f} % of one core<extra></extra>"},
        {**bar, "x": memory, "text": [f"{v:.0f} MB" for v in memory], "textposition": "auto", "xaxis": "x2", "marker": {"color": "#9fb3cc"},
         "hovertemplate": "%{y}: %{x:.0f} MB<extra></extra>"},
    ]  # fmt: skip
    layout = {
        **{
            key: value
            for key, value in time_layout([""], 10).items()
            if key in ("font", "paper_bgcolor", "plot_bgcolor")
        },
        "height": 80 + 24 * len(names),
        "margin": {"l": 150, "r": 24, "t": 10, "b": 40},
        "hovermode": "closest",
        "xaxis": {**axis, "domain": [0.0, 0.48], "title": {"text": "mean CPU load [% of one core]"}},
        "xaxis2": {**axis, "domain": [0.52, 1.0], "title": {"text": "peak memory [MB]"}},
        "yaxis": {"autorange": "reversed", "fixedrange": True, "tickmode": "linear"},
    }
    return {"data": data, "layout": layout}
