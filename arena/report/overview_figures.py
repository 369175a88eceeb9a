"""Overview figures of a run: the vehicles' states over time with the events, and the 3D map. Pure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.flight_log.flight import Flight
from arena.geometry import Array
from arena.report.errors import norm, tracking_error
from arena.report.figures import (
    Curve,
    Drawn,
    Figure,
    Panel,
    height_curves,
    over_time,
    plain,
    time_layout,
)
from arena.report.happening import Happening, Kind
from arena.report.room_figure import room_3d
from arena.report.scenario_steps import ScenarioStep

DISARMED = "disarmed"
MODE_COLOURS = {
    DISARMED: "#e3e6eb",
    "OFFBOARD": "#4c8fd6",
    "AUTO.TAKEOFF": "#7cc4a0",
    "AUTO.LOITER": "#9fd0c4",
    "AUTO.LAND": "#f0b429",
    "DESCEND": "#e07b39",
    "AUTO.RTL": "#d9a3d0",
    "POSCTL": "#a58bd6",
    "ALTCTL": "#a58bd6",
    "MANUAL": "#8a63c9",
    "STABILIZED": "#8a63c9",
    "TERMINATION": "#c0392b",
}
_OTHER_MODE = "#c7b89a"
MARKS: dict[Kind, tuple[str, str, str]] = {
    "text": ("warning of an autopilot", "circle", "#e67700"),
    "fault": ("injected fault", "diamond", "#8e24aa"),
    "pilot": ("pilot or tool", "square", "#1565c0"),
    "copilot": ("copilot", "star", "#00838f"),
    "process": ("process failed or restarted", "hexagon", "#6d4c41"),
    "refused": ("refused request", "cross", "#5d4037"),
    "failsafe": ("failsafe", "triangle-up", "#d9480f"),
    "crash": ("crash", "x", "#c0182b"),
}
"""Kind of a happening -> label, symbol and colour of its marks. Marks of a later row are drawn above those of an earlier one."""
_MAP_SIZE = 1.25  # length of the longest axis of the map, in plotly's units
_LEAST_RATIO, _LEAST_M = 0.15, 0.5
_CIRCLE = 0.02  # width of a circle as a share of the time axis
_MOST_LABELS = 60  # bands of the time line; with more bands the modes are only shown at the pointer


def timeline(vehicles: Sequence[Drawn], found: Sequence[Happening], steps: Sequence[ScenarioStep]) -> Figure:
    """Return the timeline figure: one row per vehicle, with coloured bands for its flight modes and marks for events.

    The bands show the flight mode while the vehicle is armed.

    found: what happened.  steps: steps of a scenario; they get a row of their own.
    """
    names = [plain(one.name) for one in vehicles]
    marks = _marks(names, [h for h in found if h.level in ("bad", "warn")])
    common = ["arena"] if any("arena" in trace["y"] for trace in marks) else []
    rows = [*(["scenario"] if steps else []), *names, *common]
    data = [*_bands(vehicles), *marks]
    if steps:
        data.append(_steps(steps, _range_s(vehicles)))
    layout = time_layout([""], max(120, 30 * len(rows) if len(rows) < 20 else 14 * len(rows)))
    layout |= {"barmode": "overlay", "bargap": 0.25, "hovermode": "closest"}
    layout["uniformtext"] = {"minsize": 10, "mode": "hide"}
    layout["legend"] |= {"itemclick": "toggle"}
    layout["yaxis"] |= {
        "type": "category",
        "categoryorder": "array",
        "categoryarray": rows[::-1],
        "range": [-0.6, len(rows) - 0.4],
        "title": {"text": ""},
        "tickmode": "linear" if len(rows) <= 40 else "auto",
        "showgrid": False,
        "fixedrange": True,
        "automargin": False,
        "tickfont": {"size": 11 if len(rows) < 30 else 9},
    }
    return {"data": data, "layout": layout}


def mode_spans(flight: Flight, t: Array) -> list[tuple[float, float, str]]:
    """Return (begin [s], end [s], flight mode or `disarmed`) of each time span with a constant state.

    The state is the flight mode while armed, else `disarmed`.

    t: times of the rows [s] (n,).
    """
    states = [
        mode if armed else DISARMED for mode, armed in zip(flight.mode, flight.armed.tolist(), strict=True)
    ]
    changes = [k for k in range(1, len(states)) if states[k] != states[k - 1]]
    edges = [0, *changes, len(states) - 1]
    spans = itertools.pairwise(edges)
    return [(float(t[a]), float(t[b]), states[a] or "mode unknown") for a, b in spans if b > a]


def _bands(vehicles: Sequence[Drawn]) -> list[dict[str, Any]]:
    spans = [(plain(one.name), span) for one in vehicles for span in mode_spans(one.flight, one.t)]
    data = []
    for mode in dict.fromkeys(span[2] for _, span in spans):
        own = [(name, a, b) for name, (a, b, state) in spans if state == mode]
        data.append(
            {
                "type": "bar",
                "orientation": "h",
                "name": plain(mode),
                "y": [name for name, _, _ in own],
                "base": [a for _, a, _ in own],
                "x": [b - a for _, a, b in own],
                "customdata": [[a, b] for _, a, b in own],
                "text": plain(mode) if len(spans) <= _MOST_LABELS else "",
                "textposition": "inside",
                "insidetextanchor": "middle",
                "constraintext": "inside",
                "textfont": {"size": 11, "color": "#1f2733"},
                "textangle": 0,
                "marker": {"color": MODE_COLOURS.get(mode, _OTHER_MODE), "line": {"width": 0}},
                "hovertemplate": f"%{{y}}: {plain(mode)}<br>%{{customdata[0]:.2f}} to %{{customdata[1]:.2f}} s<extra></extra>",
            }
        )
    return data


def _marks(names: Sequence[str], found: Sequence[Happening]) -> list[dict[str, Any]]:
    data = []
    for kind, (label, symbol, colour) in MARKS.items():
        own = [
            (plain(row), h)
            for h in found
            if h.kind == kind and math.isfinite(h.at_s)
            for row in h.vehicles or ("arena",)
        ]
        own = [(row if row in names else "arena", h) for row, h in own]
        if not own:
            continue
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": label,
                "x": [h.at_s for _, h in own],
                "y": [row for row, _ in own],
                "text": [plain(_short(h.text)) for _, h in own],
                "marker": {
                    "symbol": symbol,
                    "size": 12,
                    "color": colour,
                    "line": {"color": "#ffffff", "width": 1},
                },
                "hovertemplate": "%{x:.2f} s: %{text}<extra></extra>",
                "cliponaxis": False,
            }
        )
    return data


def _range_s(vehicles: Sequence[Drawn]) -> float:
    """Return the time from the start of the first log to the end of the last log [s]."""
    ends = [float(one.t[k]) for one in vehicles for k in (0, -1)]
    return max(ends) - min(ends) if ends else 0.0


def _steps(steps: Sequence[ScenarioStep], range_s: float) -> dict[str, Any]:
    """Return the trace with numbered circles for the steps of a scenario.

    Steps whose circles would overlap share one circle.

    range_s: length of the time axis [s].
    """
    groups: list[list[ScenarioStep]] = []
    for step in steps:
        if groups and step.at_s - groups[-1][0].at_s < _CIRCLE * range_s:
            groups[-1].append(step)
        else:
            groups.append([step])
    labels = [_numbers(group) for group in groups]
    return {
        "type": "scatter",
        "mode": "markers+text",
        "name": "scenario step",
        "x": [group[0].at_s for group in groups],
        "y": ["scenario"] * len(groups),
        "customdata": [
            "<br>".join(f"{one.at_s:.2f} s: step {one.number}: {plain(_short(one.words))}" for one in group)
            for group in groups
        ],
        "text": labels,
        "textfont": {"color": "#ffffff", "size": 10},
        "marker": {
            "symbol": "circle",
            "opacity": 1.0,
            "size": [17 + 5 * (len(label) - 1) for label in labels],
            "color": ["#2b8a3e" if all(one.good for one in group) else "#c0182b" for group in groups],
        },
        "hovertemplate": "%{customdata}<extra></extra>",
        "cliponaxis": False,
    }


def _numbers(group: Sequence[ScenarioStep]) -> str:
    """Return the numbers of neighbouring scenario steps as text: `4`, `4, 5`, `4-6`."""
    first, last = group[0].number, group[-1].number
    return f"{first}" if first == last else f"{first}, {last}" if last == first + 1 else f"{first}-{last}"


def _short(text: str, most: int = 110) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"


def height_and_error(vehicles: Sequence[Drawn]) -> Figure:
    """Return the figure of all vehicles' heights and tracking errors (distance to the setpoint)."""
    error = Curve(label="tracking error", values=lambda one: norm(tracking_error(one.flight)), width=1.2)
    panels = [
        Panel(title="height [m]", curves=height_curves(), digits=".2f"),
        Panel(title="tracking error [m]", curves=[error], zero=True),
    ]
    return over_time(vehicles, panels, height=215, legend=False)


# -- map -----------------------------------------------------------------------------------------------------------------------


def map_3d(
    vehicles: Sequence[Drawn], size_m: Sequence[float] | None, drawn: Mapping[str, Any] | None = None
) -> Figure:
    """Return the 3D map: paths and setpoints of all vehicles, and the room.

    x is east, y is north, z is the height [m].

    size_m: size of the flight room: north, east, height [m]; None if unknown.
    drawn: mapping with the keys `fence` and `obstacles` of slices; None if unknown.
    """
    data: list[dict[str, Any]] = room_3d(size_m, drawn or {}) if size_m else []
    for one in vehicles:
        data += _path(one)
    low, high = _extent(vehicles, size_m)
    ratio = (
        (high - low) / (high - low).max() * _MAP_SIZE
    )  # explicit, because the camera's distance refers to it
    away = max(1.0, float(np.linalg.norm(ratio)) / 1.55)  # a cube needs a larger distance than a flat room
    eye = {"x": 1.0 * away, "y": -1.55 * away, "z": 1.0 * away}
    axis = {"gridcolor": "#d9dee6", "zeroline": False, "showbackground": False, "showspikes": False}
    scene: dict[str, Any] = {
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", map(float, ratio), strict=True)),
        "camera": {"eye": eye, "center": {"x": 0.0, "y": 0.0, "z": -0.1}},
        "dragmode": "turntable",
    }
    for k, title in enumerate(("east", "north", "height")):
        scene[f"{'xyz'[k]}axis"] = {
            **axis,
            "title": {"text": f"{title} [m]"},
            "range": [float(low[k]), float(high[k])],
            "nticks": 4 if ratio[k] < 0.4 * _MAP_SIZE else 8,
        }
    layout = {
        "height": 490,
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "font": {"size": 11, "color": "#2b3340"},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "showlegend": False,
        "uirevision": "map",
        "scene": scene,
    }
    return {"data": data, "layout": layout}


def _extent(vehicles: Sequence[Drawn], size_m: Sequence[float] | None) -> tuple[Array, Array]:
    """Return the smallest and the largest east, north and height [m] (3,) of the room and of all positions.

    The extents of the axes differ at most by a factor of `_LEAST_RATIO`, so that a flight at one height can be seen.
    """
    points = [_up(one.flight.pos[one.rows]) for one in vehicles]
    if size_m:
        n, e, top = (float(x) for x in size_m)
        points.append(np.array([[-e / 2, -n / 2, 0.0], [e / 2, n / 2, top]]))
    known = np.concatenate(points)
    known = known[np.isfinite(known).all(axis=1)]
    if not known.size:
        return np.zeros(3), np.ones(3)
    low, high = known.min(axis=0), known.max(axis=0)
    low[2] = min(0.0, low[2])
    missing = np.maximum(0.0, max(_LEAST_RATIO * float((high - low).max()), _LEAST_M) - (high - low))
    high[2] += missing[2]
    low[:2], high[:2] = low[:2] - missing[:2] / 2.0, high[:2] + missing[:2] / 2.0
    return low, high


def _up(p_n: Array) -> Array:
    """Convert positions from NED to east, north, height [m] (n, 3)."""
    return np.stack([p_n[:, 1], p_n[:, 0], -p_n[:, 2]], axis=1)


def _path(one: Drawn) -> list[dict[str, Any]]:
    path = _up(one.flight.pos[one.rows])
    wanted = _up(np.where(one.flight.offboard[:, None], one.flight.group("pos_ref"), np.nan)[one.rows])
    name, meta = plain(one.name), {"vehicle": one.chip or one.name}
    known = np.flatnonzero(np.isfinite(path).all(axis=1))
    data = []
    if np.isfinite(wanted).any():
        data.append(
            {
                **_line3(wanted, one.colour, 2, "dash"),
                "name": f"{name} setpoint",
                "hovertemplate": f"{name} setpoint<br>N %{{y:.2f}}, E %{{x:.2f}}, height %{{z:.2f}} m<extra></extra>",
                "meta": {**meta, "curve": "desired"},
            }
        )
    if not known.size:
        return data
    data.append(
        {
            **_line3(path, one.colour, 4, "solid"),
            "name": name,
            "customdata": one.x,
            "hovertemplate": f"{name} at %{{customdata:.2f}} s<br>N %{{y:.2f}}, E %{{x:.2f}}, height %{{z:.2f}} m<extra></extra>",
            "meta": {**meta, "curve": "path"},
        }
    )
    for row, symbol, word in ((known[0], "circle-open", "start"), (known[-1], "x", "end")):
        data.append(
            {
                "type": "scatter3d",
                "mode": "markers",
                "x": [float(path[row, 0])],
                "y": [float(path[row, 1])],
                "z": [float(path[row, 2])],
                "marker": {
                    "symbol": symbol,
                    "size": 5 if symbol == "circle-open" else 4,
                    "color": one.colour,
                },
                "hovertemplate": f"{name}: {word}<extra></extra>",
                "meta": {**meta, "curve": word},
            }
        )
    return data


def _line3(points: Array, colour: str, width: int, dash: str) -> dict[str, Any]:
    return {
        "type": "scatter3d",
        "mode": "lines",
        "x": points[:, 0],
        "y": points[:, 1],
        "z": points[:, 2],
        "line": {"color": colour, "width": width, "dash": dash},
    }
