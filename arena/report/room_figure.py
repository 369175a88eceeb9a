"""Room in the 3D map of a report, as plotly traces: floor, edges, geofence and obstacles. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.geometry import Array
from arena.obstacles import Obstacle, obstacles_of
from arena.report.figures import GREY

FENCE = "#d98324"


def room_3d(size_m: Sequence[float], drawn: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the plotly traces of the room.

    x is east, y is north, z is the height [m].

    size_m: north, east, height [m]; the origin is the centre of the floor.
    drawn: mapping with the keys `fence` and `obstacles` of slices, which may be missing.
    """
    n, e, top = (float(x) for x in size_m)
    low, high = (-e / 2, -n / 2, 0.0), (e / 2, n / 2, top)
    traces = [_edges("room", low, high, GREY, "solid"), _floor(low, high)]
    if (fence := drawn.get("fence")) is not None:
        (south, north), (west, east) = fence["north"], fence["east"]
        traces.append(_edges("geofence", (west, south, 0.0), (east, north, fence["up"]), FENCE, "solid"))
    return traces + [_obstacle(one) for one in obstacles_of(drawn.get("obstacles"))]


def _edges(name: str, low: Sequence[float], high: Sequence[float], colour: str, dash: str) -> dict[str, Any]:
    """Return the plotly trace of the twelve edges of a box.

    low, high: east, north, height of two corners [m].
    """
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    x: list[float | None] = []
    y: list[float | None] = []
    z: list[float | None] = []
    for level in (low[2], high[2]):
        ring = [*corners, corners[0]]
        x, y = [*x, *(c[0] for c in ring), None], [*y, *(c[1] for c in ring), None]
        z += [*(level for _ in ring), None]
    for cx, cy in corners:
        x, y, z = [*x, cx, cx, None], [*y, cy, cy, None], [*z, low[2], high[2], None]
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": name,
        "x": x,
        "y": y,
        "z": z,
        "line": {"color": colour, "width": 2, "dash": dash},
        "hoverinfo": "skip",
        "meta": {"curve": "room"},
    }


def _floor(low: Sequence[float], high: Sequence[float]) -> dict[str, Any]:
    return {
        "type": "mesh3d",
        "x": [low[0], high[0], high[0], low[0]],
        "y": [low[1], low[1], high[1], high[1]],
        "z": [0.0] * 4,
        "i": [0, 0],
        "j": [1, 2],
        "k": [2, 3],
        "color": "#dfe5ee",
        "opacity": 0.6,
        "hoverinfo": "skip",
        "meta": {"curve": "room"},
    }


def _obstacle(one: Obstacle) -> dict[str, Any]:
    vertices, faces = one.mesh()
    points: Array = np.stack([vertices[:, 1], vertices[:, 0], -vertices[:, 2]], axis=1).round(4)
    return {
        "type": "mesh3d",
        "name": one.name,
        **dict(zip("xyz", points.T.tolist(), strict=True)),
        **dict(zip("ijk", faces.T.tolist(), strict=True)),
        "color": one.colour,
        "opacity": 1.0,
        "flatshading": one.shape == "box",
        "hovertemplate": f"{one.name}<extra></extra>",
        "meta": {"curve": "room"},
    }
