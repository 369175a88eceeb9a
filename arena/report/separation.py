"""Distances between vehicles over time, and the smallest distance in a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arena.geometry import Array
from arena.report.figures import Drawn, Figure, plain, time_layout
from arena.report.happenings import in_air

_MOST_VALUES = 20_000_000  # rows times pairs of vehicles; more rows are thinned


@dataclass(frozen=True, kw_only=True)
class Separation:
    """Smallest distance between two vehicles in a run while at least one of the two was in the air.

    distance_m: distance between the body origins [m].  at_s: its time on the report's axis [s].  names: the two vehicles.
    """

    distance_m: float
    at_s: float
    names: tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Distances:
    """Distance of each vehicle to its nearest neighbour over time.

    t: times on the report's axis [s] (m,).  nearest_m: distance [m] (n, m), NaN while both vehicles are on the floor.
    other: index of the nearest vehicle [-] (n, m).
    """

    t: Array
    nearest_m: Array
    other: np.ndarray


def distances(vehicles: Sequence[Drawn]) -> Distances | None:
    """Return the distance of each vehicle to its nearest neighbour, or None for fewer than two vehicles.

    The times are those of the log with the most rows, and those of the other logs before and after it.
    """
    if len(vehicles) < 2:
        return None
    t = _times(vehicles)
    t = t[:: max(1, -(-(len(vehicles) ** 2) * t.size // _MOST_VALUES))]
    p_n = np.stack([_at(one, t) for one in vehicles])
    flying = np.stack([np.interp(t, one.t, in_air(one.flight), 0.0, 0.0) > 0.0 for one in vehicles])
    nearest, other = np.full(flying.shape, np.nan), np.zeros(flying.shape, int)
    for i in range(len(vehicles)):
        apart = np.linalg.norm(p_n - p_n[i], axis=2)
        apart[~(flying | flying[i])] = np.nan
        apart[i] = np.nan
        apart = np.where(np.isfinite(apart), apart, np.inf)
        other[i] = apart.argmin(axis=0)
        nearest[i] = apart.min(axis=0)
    nearest[np.isinf(nearest)] = np.nan
    return Distances(t=t, nearest_m=nearest, other=other)


def _times(vehicles: Sequence[Drawn]) -> Array:
    """Return the times of the log with the most rows, extended to the first start and to the last end of all logs [s] (m,)."""
    logs = [one.t for one in vehicles if one.t.size]
    t = max(logs, key=len)
    for log in sorted(logs, key=lambda log: float(log[0]), reverse=True):
        t = np.concatenate([log[log < t[0]], t])
    for log in sorted(logs, key=lambda log: float(log[-1])):
        t = np.concatenate([t, log[log > t[-1]]])
    return t


def _at(one: Drawn, t: Array) -> Array:
    """Return a vehicle's positions at the times t, interpolated from its log [m] [NED] (m, 3).

    Positions before and after the log are NaN.

    t: [s] (m,).
    """
    pos = one.flight.pos
    known = np.isfinite(pos).all(axis=1)
    if not known.any():
        return np.full((t.size, 3), np.nan)
    own = one.t[known]
    columns = [np.interp(t, own, pos[known, k], np.nan, np.nan) for k in range(3)]
    return np.stack(columns, axis=1)


def smallest(found: Distances | None, vehicles: Sequence[Drawn]) -> Separation | None:
    """Return the smallest distance between two vehicles in a run, or None if no distance is known."""
    if found is None or not np.isfinite(found.nearest_m).any():
        return None
    i, k = np.unravel_index(int(np.nanargmin(found.nearest_m)), found.nearest_m.shape)
    first, second = sorted((int(i), int(found.other[i, k])))
    return Separation(
        distance_m=float(found.nearest_m[i, k]),
        at_s=float(found.t[k]),
        names=(vehicles[first].name, vehicles[second].name),
    )


def separation_figure(found: Distances, vehicles: Sequence[Drawn]) -> Figure:
    """Return the figure of each vehicle's distance to its nearest neighbour over time."""
    data = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": found.t,
            "y": found.nearest_m[i],
            "name": plain(one.name),
            "showlegend": False,
            "line": {"color": one.colour, "width": 1.4},
            "hovertemplate": f"%{{y:.2f}} m<extra>{plain(one.name)} to the nearest</extra>",
            "meta": {"vehicle": one.chip or one.name, "curve": "distance"},
        }
        for i, one in enumerate(vehicles)
        if np.isfinite(found.nearest_m[i]).any()
    ]
    return {"data": data, "layout": time_layout(["distance to the<br>nearest vehicle [m]"], 190, zero=[True])}
