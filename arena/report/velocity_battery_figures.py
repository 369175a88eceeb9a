"""Figures of the vehicles' velocity, battery and thrust. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from arena.geometry import Array
from arena.report.figures import Curve, Drawn, Figure, Panel, column, desired, over_time

_THRESHOLDS = {"BAT_LOW_THR": "#b45309", "BAT_CRIT_THR": "#c0182b", "BAT_EMERGEN_THR": "#7a0c1c"}
"""Name of PX4's parameter -> colour of its line. These parameters are thresholds of the battery charge [-] (0 to 1)."""


def velocity(vehicles: Sequence[Drawn]) -> Figure:
    """Return the figure of the velocity: actual or estimated values, and setpoints."""
    panels = []
    for part, title, scale in (("north", "north", 1.0), ("east", "east", 1.0), ("down", "up", -1.0)):
        curves = (
            Curve(label="actual", values=_velocity(part, scale)),
            Curve(label="desired", values=desired("vel_ref", part, scale), dash="dash", width=1.1),
        )
        panels.append(Panel(title=f"{title} [m/s]", curves=curves))
    return over_time(vehicles, panels, height=130)


def _velocity(part: str, scale: float) -> Callable[[Drawn], Array]:
    return lambda one: column("truth.vel" if one.flight.simulated else "ekf.vel", part, scale)(one)


def battery(
    vehicles: Sequence[Drawn], params: Mapping[str, Mapping[str, float]], time_s: Sequence[float]
) -> Figure:
    """Return the figure of battery charge and thrust setpoint.

    The battery thresholds of PX4 are drawn as lines.

    params: vehicle -> parameters of its autopilot.  time_s: first and last time of the thresholds [s].
    """
    panels = [
        Panel(
            title="battery [%]",
            curves=[Curve(label="charge", values=_plain_column("info.battery"))],
            digits=".0f",
        ),
        Panel(
            title="thrust [0..1]",
            curves=[Curve(label="thrust setpoint", values=_plain_column("thrust_ref"), width=1.1)],
            digits=".2f",
        ),
    ]
    figure = over_time(vehicles, panels, height=150, legend=False)
    figure["layout"]["yaxis"]["range"] = [0, 104]  # the charge 100 % is below the upper edge
    if figure["data"]:
        figure["data"] += _thresholds([params.get(one.name, {}) for one in vehicles], time_s)
    return figure


def _thresholds(params: Sequence[Mapping[str, float]], time_s: Sequence[float]) -> list[dict[str, Any]]:
    """Return the horizontal lines of the figure for PX4's battery thresholds (BAT_LOW_THR, ...).

    Vehicles with the same value share a line.
    """
    lines = []
    for name, colour in _THRESHOLDS.items():
        for percent in sorted({round(100.0 * float(p[name]), 3) for p in params if name in p}, reverse=True):
            text = f"{name} {percent:g} %"
            lines.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": list(time_s),
                    "y": [percent, percent],
                    "yaxis": "y",
                    "name": text,
                    "line": {"color": colour, "dash": "dash", "width": 1.2},
                    "hovertemplate": f"{text}<extra></extra>",
                    "meta": {"legend": text},
                }
            )
    return lines


def _plain_column(name: str) -> Callable[[Drawn], Array]:
    return lambda one: one.flight.numbers.get(name, np.full(one.flight.t.size, np.nan))
