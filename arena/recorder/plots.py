"""Plots of flights: actual and desired values over time for each vehicle, and the paths of all vehicles.

The layout is fixed, because matplotlib's constrained layout draws every figure twice, which is slow.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from arena.geometry import Array
from arena.recorder.columns import NED, RPY
from arena.recorder.flight_log import COLUMNS_OF, Flight

MAX_POINTS = 1500
_ERROR_AXES = (
    ("err.pos", NED, "position [mm]", 1e3),
    ("err.vel", NED, "velocity [mm/s]", 1e3),
    ("err.att_euler", RPY, "attitude [deg]", 180.0 / np.pi),
)
_DPI = 90
_ACTUAL, _ESTIMATE, _DESIRED = "tab:blue", "tab:orange", "black"


def plot_vehicle(flight: Flight, folder: Path) -> list[Path]:
    """Write the plots of one vehicle and return their paths.

    The plots are position, velocity, attitude and rates, and for a simulated vehicle also estimator_error.
    """
    actual, degrees = COLUMNS_OF[flight.position_source], np.degrees
    moving = actual if flight.simulated else "ekf"  # motion capture measures no velocity and no rates
    pictures = [
        _group(flight, folder, "position", "m", NED, (actual + ".pos", "ekf.pos", "pos_ref")),
        _group(flight, folder, "velocity", "m/s", NED, (moving + ".vel", "ekf.vel", "vel_ref")),
        _group(
            flight,
            folder,
            "attitude",
            "deg",
            RPY,
            (actual + ".att_euler", "ekf.att_euler", "att_euler_ref"),
            degrees,
        ),
        _group(
            flight,
            folder,
            "rates",
            "deg/s",
            RPY,
            (moving + ".ang_vel", "ekf.ang_vel", "ang_vel_ref"),
            degrees,
        ),
    ]
    if flight.simulated:
        pictures.append(_errors(flight, folder))
    return pictures


def _three_axes() -> tuple[Any, Any]:
    figure = Figure(figsize=(9, 6.5))
    figure.subplots_adjust(left=0.1, right=0.98, bottom=0.08, top=0.92, hspace=0.1)
    return figure, figure.subplots(3, 1, sharex=True)


def _group(
    flight: Flight,
    folder: Path,
    title: str,
    unit: str,
    parts: Sequence[str],
    names: tuple[str, str, str],
    scale: Any = None,
) -> Path:
    """Plot the three components of one quantity, such as position, over time. Return the path of the plot.

    names: column groups of the actual, estimated and desired values.  scale: function that converts the values to `unit`.
    """
    figure, rows = _three_axes()
    thin = _thin(flight.t.size)
    lines = [(names[1], _ESTIMATE, "-", "estimate", 2.5)] if names[0] != names[1] else []
    lines += [(names[0], _ACTUAL, "-", f"actual ({flight.position_source if lines else 'estimate'})", 1.0)]
    lines += [(names[2], _DESIRED, "--", "desired", 0.8)]
    for name, colour, style, label, width in lines:
        values = flight.group(name, parts)[thin]
        values = scale(values) if scale else values
        for axes, column in zip(rows, values.T, strict=True):
            axes.plot(flight.t[thin], column, style, color=colour, label=label, linewidth=width)
    return _finish(figure, rows, flight, folder, title, unit, parts)


def _errors(flight: Flight, folder: Path) -> Path:
    figure, rows = _three_axes()
    thin = _thin(flight.t.size)
    for axes, (name, parts, label, scale) in zip(rows, _ERROR_AXES, strict=True):
        for part, column in zip(parts, flight.group(name, parts)[thin].T, strict=True):
            axes.plot(flight.t[thin], column * scale, label=part, linewidth=0.8)
        axes.legend(loc="upper right", ncols=3, fontsize="small")
        axes.set_ylabel(label)
    return _finish(figure, rows, flight, folder, "estimator_error", "", ())


def _finish(
    figure: Any, rows: Any, flight: Flight, folder: Path, title: str, unit: str, parts: Sequence[str]
) -> Path:
    for axes, part in zip(rows, parts, strict=False):
        axes.set_ylabel(f"{part} [{unit}]")
    for axes in rows:
        axes.grid(alpha=0.3)
    if parts:
        rows[0].legend(loc="upper right", ncols=3, fontsize="small")
    rows[-1].set_xlabel("time since the log began [s]")
    figure.suptitle(
        f"{flight.name}: {title.replace('_', ' ')}" + (" (estimate minus truth)" if not parts else "")
    )
    return _save(figure, folder / f"{flight.name}_{title}.png")


def plot_all(flights: Sequence[Flight], size_m: Sequence[float] | None, folder: Path) -> Path:
    """Plot the paths of all vehicles from above (north up, east right) and from the east. Return the path of the plot.

    size_m: size of the flight room: north, east, height [m]; None if unknown.
    """
    figure = Figure(figsize=(11, 6.5))
    figure.subplots_adjust(left=0.06, right=0.98, bottom=0.09, top=0.87, wspace=0.15)
    above, side = figure.subplots(1, 2)
    for i, flight in enumerate(flights):
        _plot_path(above, side, flight, f"C{i % 10}")
    above.set(xlabel="east [m]", ylabel="north [m]", title="from above")
    side.set(xlabel="north [m]", ylabel="height [m]", title="from the side (east)")
    if size_m:
        _plot_room(above, side, size_m)
    for axes in (above, side):
        axes.set_aspect("equal")
        axes.grid(alpha=0.3)
    above.legend(loc="upper right", fontsize="small")
    figure.suptitle("flight: circles are starts, crosses are ends, dashed lines are position references")
    return _save(figure, folder / "flight.png")


def _plot_path(above: Any, side: Any, flight: Flight, colour: str) -> None:
    pos, ref = flight.pos[_thin(flight.t.size)], _reference_in_offboard(flight)[_thin(flight.t.size)]
    for axes, across, up, sign in ((above, 1, 0, 1.0), (side, 0, 2, -1.0)):
        axes.plot(pos[:, across], sign * pos[:, up], color=colour, linewidth=1.2, label=flight.name)
        axes.plot(ref[:, across], sign * ref[:, up], "--", color=colour, linewidth=0.7, alpha=0.7)
        known = pos[np.isfinite(pos).all(axis=1)]
        if known.size:
            axes.plot(
                known[0, across], sign * known[0, up], "o", color=colour, markersize=7, fillstyle="none"
            )
            axes.plot(known[-1, across], sign * known[-1, up], "x", color=colour, markersize=8)


def _reference_in_offboard(flight: Flight) -> Array:
    return np.where(flight.offboard[:, None], flight.group("pos_ref"), np.nan)


def _plot_room(above: Any, side: Any, size_m: Sequence[float]) -> None:
    n, e, height = (float(x) for x in size_m)
    above.plot(
        [-e / 2, e / 2, e / 2, -e / 2, -e / 2],
        [-n / 2, -n / 2, n / 2, n / 2, -n / 2],
        color="grey",
        linewidth=1.5,
    )
    side.plot([-n / 2, n / 2, n / 2, -n / 2, -n / 2], [0, 0, height, height, 0], color="grey", linewidth=1.5)


def _thin(size: int) -> slice:
    return slice(None, None, max(1, size // MAX_POINTS))


def _save(figure: Any, path: Path) -> Path:
    figure.savefig(path, dpi=_DPI)
    return path
