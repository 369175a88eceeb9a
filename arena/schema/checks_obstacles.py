"""Cross-checks of the obstacles in the room: their sizes and places. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator

from arena.errors import Problem
from arena.obstacles import SIZES, Obstacle, gap_to_vehicle_m
from arena.schema.arena import Vehicle
from arena.schema.checking import Check

START_GAP_M = 0.05
"""Smallest distance of a vehicle at its start to an obstacle [m]. A vehicle that touches one has crashed."""
_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_ROUNDING_M = 1e-6


def obstacles(c: Check) -> Iterator[Problem]:
    """Check the size and place of each obstacle: right number of values, inside the room, away from start positions."""
    if any(path[:2] in (("world", "obstacles"), ("world", "size")) for path in c.pruned):
        return
    for name, given in c.arena.world.obstacles.items():
        path = ("world", "obstacles", name)
        if not _NAME.fullmatch(name):
            said = "expected at most 32 lower-case letters, digits and _, starting with a letter"
            yield c.source.problem(path, f"got {name!r}, {said}.")
            continue
        body = given.body(name)
        if body is None:
            words = SIZES[given.shape]
            said = f"got {len(given.size)} numbers, expected {len(words)} for a {given.shape}: {', '.join(words)}"
            yield c.source.problem((*path, "size"), f"{said}.")
            continue
        outside = list(_outside(c, body))
        yield from outside
        for vehicle in c.arena.simulated if not outside else ():
            yield from _start(c, body, vehicle)


def _outside(c: Check, body: Obstacle) -> Iterator[Problem]:
    """Check that an obstacle is inside the room."""
    north, east, height = c.arena.world.size
    path = ("world", "obstacles", body.name, "position")
    half = body.half_extents_n
    for axis, word, wall in ((0, "N", north / 2.0), (1, "E", east / 2.0)):
        value, room = body.centre_n[axis], wall - half[axis]
        if abs(value) > room + _ROUNDING_M:
            if room < 0.0:
                said = f"the obstacle is {2.0 * half[axis]:.2f} m long on the axis {word}, the room is {2.0 * wall:g} m long"
                yield c.source.problem(path, f"{said}. Make it smaller.")
            else:
                said = f"is outside the room: got {word} {value:g}, expected {-room:.2f} .. {room:.2f}"
                yield c.source.problem(path, f"{said}.")
    low = body.centre_n[2] + half[2]
    if low > _ROUNDING_M:
        said = f"is below the floor: got D {low:g}, expected 0 or less, because D points down"
        yield c.source.problem(path, f"{said}. Try {-low:g} or 0.")
    elif (top := 2.0 * half[2] - low) > height + _ROUNDING_M:
        said = f"is outside the room: its highest point is {top:.2f} m above the floor, the ceiling is at {height:g} m"
        yield c.source.problem(path, f"{said}. Make it smaller, or lower it.")


def _start(c: Check, body: Obstacle, v: Vehicle) -> Iterator[Problem]:
    """Check that a vehicle does not touch an obstacle at its start."""
    if not c.sound(v, "start", "profile"):
        return
    gap = gap_to_vehicle_m(body, v.position, v.profile.radius_m, v.profile.height_m)
    if gap < START_GAP_M:
        at, line = c.source.place(("world", "obstacles", body.name))
        where = f"{at}:{line}" if line else at
        said = f"is too near to the obstacle {body.name} ({where}): got a gap of {gap:.2f} m, expected at least {START_GAP_M:g} m"
        yield c.problem(v.name, ("start", "position"), f"{said}. Move one of them.")
