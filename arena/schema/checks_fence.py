"""Checks of the geofence against other keys of the YAML: the room and the start positions. Pure.

The box must not be empty. With simulated vehicles, the box must lie inside the room, and they must start inside the box.
"""

from __future__ import annotations

from collections.abc import Iterator

from arena.errors import Problem
from arena.schema.arena import Vehicle
from arena.schema.checking import Check

_ROUNDING_M = 1e-9


def fence(c: Check) -> Iterator[Problem]:
    box = c.arena.geofence
    if box is None or any(path[0] == "geofence" or path == ("world", "size") for path in c.pruned):
        return
    wrong = [*_span(c, "north", box.north), *_span(c, "east", box.east), *_up(c, box.up)]
    yield from wrong
    if not wrong:
        for v in c.arena.simulated:
            if c.sound(v, "start", "profile"):
                yield from _start(c, v)


def _span(c: Check, axis: str, kept: tuple[float, float]) -> Iterator[Problem]:
    """Check the geofence's two limits on one horizontal axis: their order, the margin, the room's walls.

    kept: lowest and highest coordinate [m], already reduced by the margin.
    """
    margin, wall = _margin(c), c.arena.world.size[axis == "east"] / 2.0
    low, high = kept[0] - margin, kept[1] + margin
    if low >= high:
        said = f"got [{low:g}, {high:g}], expected the smaller number first"
        yield c.source.problem(("geofence", axis), f"{said}. Try [{high:g}, {low:g}].")
    elif kept[0] >= kept[1]:
        said = f"got {margin:g}, which is too large: nothing remains of {axis} {low:g} .. {high:g}"
        yield c.source.problem(("geofence", "margin_m"), f"{said}. Try {(high - low) / 8.0:.2g}.")
    elif c.arena.simulated and (low < -wall - _ROUNDING_M or high > wall + _ROUNDING_M):
        near = low < wall and high > -wall
        best = (max(low, -wall), min(high, wall)) if near else (-wall, wall)
        said = f"got [{low:g}, {high:g}], expected within the room's walls, {-wall:g} .. {wall:g}"
        yield c.source.problem(("geofence", axis), f"{said}. Try [{best[0]:g}, {best[1]:g}].")


def _up(c: Check, kept: float) -> Iterator[Problem]:
    margin, height = _margin(c), c.arena.world.size[2]
    up = kept + margin
    if kept <= 0.0:
        said = f"got {margin:g}, which is too large: nothing remains of a fence {up:g} m high"
        yield c.source.problem(("geofence", "margin_m"), f"{said}. Try {up / 8.0:.2g}.")
    elif c.arena.simulated and up > height + _ROUNDING_M:
        said = f"got {up:g}, expected at most the room's height, {height:g}"
        yield c.source.problem(("geofence", "up"), f"{said}. Try {height:g}.")


def _start(c: Check, v: Vehicle) -> Iterator[Problem]:
    """Check that a vehicle's centre is inside the geofence at the start."""
    box, (n, e, d) = c.arena.geofence, v.position
    if box is None:
        return
    file, line = c.source.place(("geofence",))
    for axis, value, (low, high) in (("N", n, box.north), ("E", e, box.east)):
        if not low <= value <= high:
            said = f"starts outside the geofence ({file}:{line}): got {axis} {value:g}, expected {low:g} .. {high:g}"
            yield c.problem(v.name, ("start", "position"), f"{said}. Move it, or the fence.")
    most = box.up - v.profile.ground_clearance_m
    if -d >= most:
        said = f"starts above the geofence ({file}:{line}): got D {d:g}, expected more than {-most:.2f}"
        yield c.problem(v.name, ("start", "position"), f"{said}. Move it, or the fence.")


def _margin(c: Check) -> float:
    return float(c.source.value(("geofence", "margin_m")) or 0.0)
