"""Interactive figures of flights over time: dictionaries with `data` and `layout`, as plotly needs them. Pure.

Arrays stay numpy arrays; `arena.report.page` encodes them. The key `meta` of a trace names its vehicle, so that the page can
show and hide vehicles. All figures over time have the same time axis (x).
"""

from __future__ import annotations

import colorsys
import html
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.flight_log.columns import NED
from arena.flight_log.flight import COLUMNS_OF, Flight
from arena.geometry import Array
from arena.report.happenings import in_air

Figure = dict[str, Any]
Indices = NDArray[np.int_]

MAX_POINTS = 240_000
"""Rows of all vehicles together that are drawn; more rows are thinned. The page then has at most some 10 MB."""
LEAST_POINTS = 500
_PALETTE = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#b8860b",
    "#56b4e9",
    "#6a3d9a",
    "#b15928",
    "#33a02c",
    "#e31a1c",
)
GREY = "#8a919c"
_GRID = "#e6e9ee"
_FONT = {
    "family": "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif",
    "size": 12,
    "color": "#2b3340",
}
_LEFT, _RIGHT = (
    76,
    12,
)  # margins [px], the same in all figures, so that their time axes stand below one another


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """Vehicle whose flight a figure shows.

    name: name of the vehicle.  flight: its log.  t: time on the report's axis [s] (n,).  rows: indices of the rows that are drawn (m,).
    colour: colour of the vehicle, as #rrggbb.  chip: name by which the page shows and hides the vehicle, "" for `name`.
    """

    name: str
    flight: Flight
    t: Array
    rows: Indices
    colour: str
    chip: str = ""

    @property
    def x(self) -> Array:
        """Times of the plotted log rows [s] (m,)."""
        times: Array = self.t[self.rows]
        return times


def drawn(flights: Mapping[str, Flight], origins_s: Mapping[str, float]) -> list[Drawn]:
    """Return the vehicles that a figure shows, with their colours and the log rows to plot.

    origins_s: vehicle -> time of its log that is 0 on the report's time axis [s].
    """
    most = max(LEAST_POINTS, MAX_POINTS // max(1, 10 * len(flights)))
    return [
        Drawn(
            name=name,
            flight=flight,
            t=flight.t + flight.t0 - origins_s[name],
            rows=thinned(flight, most),
            colour=colour(k, len(flights)),
        )
        for k, (name, flight) in enumerate(flights.items())
    ]


def thinned(flight: Flight, most: int) -> Indices:
    """Return the indices of at most `most` rows of a log, to keep a figure small.

    Rows with the largest tracking errors are kept.

    Of each group of neighbouring rows the first one is kept, and the one with the largest tracking error, so that peaks stay
    visible.
    """
    size = flight.t.size
    if size <= most:
        return np.arange(size)
    error = np.nan_to_num(np.linalg.norm(flight.pos - flight.group("pos_ref"), axis=1), nan=-1.0)
    width = -(-2 * size // most)
    padded = np.full(-(-size // width) * width, -2.0)
    padded[:size] = error
    firsts = np.arange(0, size, width)
    peaks = firsts + padded.reshape(-1, width).argmax(axis=1)
    return np.unique(np.concatenate([firsts, peaks, [size - 1]]))


def colour(k: int, count: int) -> str:
    """Return the colour of vehicle number k of `count` vehicles, as #rrggbb."""
    if count <= len(_PALETTE):
        return _PALETTE[k]
    hue, light = (k * 0.618034) % 1.0, (0.36, 0.46, 0.56)[k % 3]
    red, green, blue = colorsys.hls_to_rgb(hue, light, 0.62)
    return f"#{round(255 * red):02x}{round(255 * green):02x}{round(255 * blue):02x}"


def plain(text: str) -> str:
    """Escape a text so that plotly shows it unchanged.

    Plotly interprets HTML tags and entities in texts.
    """
    return html.escape(text, quote=False)


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Kind of curve in a panel, such as `desired`. Every vehicle gets one curve of this kind.

    label: name of the curve in the legend, such as `desired`.  values: function from a vehicle to its values (n,).
    dash: line style of plotly.  width: line width [px].  opacity: 0..1.
    """

    label: str
    values: Callable[[Drawn], Array]
    dash: str = "solid"
    width: float = 1.6
    opacity: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Panel of a figure: its y-axis with title and unit, and its curves.

    digits: format of the values, as in d3.  zero: the axis begins at 0.  least: the axis of a vehicle shows at least this range
        around its median value, so that noise does not fill the panel.
    """

    title: str
    curves: Sequence[Curve]
    digits: str = ".3f"
    zero: bool = False
    least: float = 0.0


def over_time(
    vehicles: Sequence[Drawn], panels: Sequence[Panel], *, height: int = 170, legend: bool = True
) -> Figure:
    """Return a figure with its panels one above the other. All panels share the time axis.

    height: height of one panel [px].  legend: show the line styles of the curves.
    """
    data = [
        _line(one, curve, panel, number)
        for number, panel in enumerate(panels, start=1)
        for one in vehicles
        for curve in panel.curves
    ]
    data = [trace for trace in data if np.isfinite(trace["y"]).any()]
    data += [
        _least_range(trace, panel.least)
        for number, panel in enumerate(panels, start=1)
        for trace in data
        if panel.least and trace["yaxis"] == ("y" if number == 1 else f"y{number}")
    ]
    styles = {curve.label: curve for panel in panels for curve in panel.curves} if legend else {}
    if len(styles) > 1:
        data += [_legend_entry(curve) for curve in styles.values()]
    return {
        "data": data,
        "layout": time_layout([panel.title for panel in panels], height, zero=[p.zero for p in panels]),
    }


def _line(one: Drawn, curve: Curve, panel: Panel, number: int) -> dict[str, Any]:
    axis = "" if number == 1 else str(number)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": one.x,
        "y": curve.values(one)[one.rows],
        "yaxis": f"y{axis}",
        "name": plain(f"{one.name} {curve.label}"),
        "showlegend": False,
        "opacity": curve.opacity,
        "line": {"color": one.colour, "dash": curve.dash, "width": curve.width},
        "hovertemplate": f"%{{y:{panel.digits}}}<extra>{plain(one.name)} {plain(curve.label)}</extra>",
        "meta": {"vehicle": one.chip or one.name, "curve": curve.label},
    }


def _least_range(trace: dict[str, Any], least: float) -> dict[str, Any]:
    """Return an invisible trace that keeps the y-axis from a too small range. The range is around the median of a curve.

    The range prevents that noise fills the panel.
    """
    middle, x = float(np.nanmedian(trace["y"])), float(trace["x"][0])
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [x, x],
        "y": [middle - least / 2.0, middle + least / 2.0],
        "yaxis": trace["yaxis"],
        "showlegend": False,
        "hoverinfo": "skip",
        "marker": {"opacity": 0.0},
        "meta": {**trace["meta"], "curve": "range"},
    }


def _legend_entry(curve: Curve) -> dict[str, Any]:
    """Return an empty trace that shows the line style of a curve in the legend."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [None],
        "y": [None],
        "name": plain(curve.label),
        "hoverinfo": "skip",
        "opacity": curve.opacity,
        "line": {"color": "#4a5361", "dash": curve.dash, "width": curve.width},
        "meta": {"legend": curve.label},
    }


def time_layout(titles: Sequence[str], height: int, *, zero: Sequence[bool] = ()) -> dict[str, Any]:
    """Return the plotly layout of a figure over time, with one panel per title.

    height: height of one panel [px].  zero: panels whose axis begins at 0.
    """
    count, gap = len(titles), 0.0 if len(titles) == 1 else 18.0 / (height * len(titles))
    share = (1.0 - gap * (count - 1)) / count
    layout: dict[str, Any] = {
        "height": height * count + 62,
        "margin": {"l": _LEFT, "r": _RIGHT, "t": 26, "b": 36},
        "font": _FONT,
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "#ffffff",
        "hovermode": "x",
        "hoverlabel": {"namelength": -1, "font": {"size": 11}},
        "dragmode": "zoom",
        "legend": {
            "orientation": "h",
            "x": 0.0,
            "xanchor": "left",
            "y": 1.0,
            "yanchor": "bottom",
            "itemclick": False,
            "itemdoubleclick": False,
        },
        "xaxis": {
            "title": {"text": "time [s]", "standoff": 4},
            "gridcolor": _GRID,
            "zeroline": False,
            "anchor": "y" if count == 1 else f"y{count}",
            "ticks": "outside",
            "tickcolor": _GRID,
            "hoverformat": ".2f",
        },
    }
    for number, title in enumerate(titles, start=1):
        top = 1.0 - (number - 1) * (share + gap)
        layout["yaxis" if number == 1 else f"yaxis{number}"] = {
            "title": {"text": title, "standoff": 6},
            "domain": [max(0.0, top - share), top],
            "gridcolor": _GRID,
            "zeroline": False,
            "linecolor": "#c9ced6",
            "mirror": True,
            "anchor": "x",
            "rangemode": "tozero" if zero and zero[number - 1] else "normal",
        }
    return layout


# -- quantities of a vehicle ---------------------------------------------------------------------------------------------------


def column(group: str, part: str, scale: float = 1.0) -> Callable[[Drawn], Array]:
    """Return a function that reads one log column of a vehicle (n,), multiplied by `scale`.

    Missing columns are NaN.
    """
    return lambda one: scale * one.flight.numbers.get(f"{group}.{part}", np.full(one.flight.t.size, np.nan))


def actual(quantity: str, part: str, scale: float = 1.0) -> Callable[[Drawn], Array]:
    """Return a function that reads a quantity of one vehicle from the best source in its log, as an array (n,).

    `Flight` explains which source is used.

    quantity: `pos` or `att_euler`.
    """
    return lambda one: column(f"{COLUMNS_OF[one.flight.position_source]}.{quantity}", part, scale)(one)


def estimate(quantity: str, part: str, scale: float = 1.0) -> Callable[[Drawn], Array]:
    """Return a function that reads the autopilot's estimate of one quantity of a vehicle (n,).

    It returns NaN if the estimate already serves as the actual value.
    """

    def values(one: Drawn) -> Array:
        same = one.flight.position_source == "estimate"
        return np.full(one.flight.t.size, np.nan) if same else column(f"ekf.{quantity}", part, scale)(one)

    return values


def desired(quantity: str, part: str, scale: float = 1.0) -> Callable[[Drawn], Array]:
    """Return a function that reads a setpoint of a vehicle in OFFBOARD (n,); NaN in other flight modes.

    On the ground only position setpoints are shown. Setpoints that the autopilot computes from the position, such as the velocity,
    do not describe the flight before the take-off.
    quantity: group of columns, such as `pos_ref`.
    """

    def values(one: Drawn) -> Array:
        shown = one.flight.offboard if quantity == "pos_ref" else one.flight.offboard & in_air(one.flight)
        return np.where(shown, column(quantity, part, scale)(one), np.nan)

    return values


def three(quantity: str, reference: str, part: str, scale: float) -> tuple[Curve, Curve, Curve]:
    """Return the three curves of a quantity: estimate, actual and desired values.

    reference: group of columns of the desired value.
    """
    return (
        Curve(
            label="estimate",
            values=_unwrapped(estimate(quantity, part, scale), quantity),
            width=3.2,
            opacity=0.35,
        ),
        Curve(label="actual", values=_unwrapped(actual(quantity, part, scale), quantity)),
        Curve(
            label="desired",
            values=_unwrapped(desired(reference, part, scale), quantity),
            dash="dash",
            width=1.1,
        ),
    )


def _unwrapped(values: Callable[[Drawn], Array], quantity: str) -> Callable[[Drawn], Array]:
    """Wrap a function that returns angles: at a jump from 180 to -180 degrees it returns NaN, a gap in the curve."""
    if quantity != "att_euler":
        return values

    def broken(one: Drawn) -> Array:
        given = np.array(values(one))
        jumps = np.abs(np.diff(given, prepend=given[:1])) > 300.0
        given[jumps] = np.nan
        return given

    return broken


_DEG = 180.0 / np.pi


def position(vehicles: Sequence[Drawn]) -> Figure:
    """Return the figure of position and yaw: actual, estimated and desired values."""
    panels = [Panel(title=f"{part} [m]", curves=three("pos", "pos_ref", part, 1.0)) for part in NED[:2]]
    panels.append(Panel(title="height [m]", curves=three("pos", "pos_ref", "down", -1.0)))
    yaw = list(three("att_euler", "att_euler_ref", "yaw", _DEG))
    yaw[2] = Curve(label="desired", values=_unwrapped(_yaw_reference, "att_euler"), dash="dash", width=1.1)
    panels.append(Panel(title="yaw [deg]", curves=yaw, digits=".1f", least=2.0))
    return over_time(vehicles, panels, height=150)


def _yaw_reference(one: Drawn) -> Array:
    """Return the desired yaw [deg] (n,): that of the position setpoint, or else of the attitude setpoint."""
    own = one.flight.numbers.get("pos_ref.yaw")
    if own is None or not np.isfinite(own).any():
        return desired("att_euler_ref", "yaw", _DEG)(one)
    return np.where(one.flight.offboard, own * _DEG, np.nan)


def height_curves() -> tuple[Curve, Curve]:
    """Return the curves of the height: actual and desired."""
    return three("pos", "pos_ref", "down", -1.0)[1:]
