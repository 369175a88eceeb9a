"""The geofence of one vehicle: polygons and circles that were uploaded, and the distances from home that parameters set.

What is inside is decided here; what follows from being outside (GF_ACTION) is the commander's. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.navigation.mission_items import FENCE_COMMANDS, POLYGONS, Item, local

Point = tuple[float, float]
_INCLUSIONS = (mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION)


@dataclass(frozen=True, slots=True, kw_only=True)
class Area:
    """One polygon or circle. corners: north, east [m], one alone for a circle; inside: must the vehicle be in it, or out?"""

    corners: tuple[Point, ...]
    radius_m: float
    inside: bool

    def holds(self, p: Point) -> bool:
        """Is this area content with a vehicle at p (north, east)?"""
        return (self._in_circle(p) if len(self.corners) == 1 else self._in_polygon(p)) == self.inside

    def _in_circle(self, p: Point) -> bool:
        return math.dist(p, self.corners[0]) < self.radius_m

    def _in_polygon(self, p: Point) -> bool:
        """How many edges lie north of p: odd means inside (Jordan's curve theorem)."""
        crossings = 0
        for (n1, e1), (n2, e2) in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            if (e1 > p[1]) != (e2 > p[1]) and p[0] < n1 + (n2 - n1) * (p[1] - e1) / (e2 - e1):
                crossings += 1
        return crossings % 2 == 1


def areas(items: Sequence[Item], origin: tuple[float, float, float]) -> list[Area]:
    """The areas of an uploaded fence; a polygon whose corners are not all there is closed over those that are."""
    found, k = [], 0
    while k < len(items):
        item = items[k]
        polygon = item.command in POLYGONS
        length = max(1, int(item.params[0])) if polygon else 1
        corners = tuple(local(origin, c.x, c.y) for c in items[k : k + length])
        if item.command in FENCE_COMMANDS and not (polygon and len(corners) < 3):
            found.append(Area(corners=corners, radius_m=item.params[0], inside=item.command in _INCLUSIONS))
        k += length
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Fence:
    """What holds for one vehicle. home_n: [m] [NED], None while there is none; the distances are off at 0."""

    areas: tuple[Area, ...] = ()
    home_n: tuple[float, float, float] | None = None
    max_horizontal_m: float = 0.0
    max_vertical_m: float = 0.0

    def breach(self, p_n: Sequence[float]) -> str:
        """What is violated at p_n [m] [NED], in PX4's words; "" inside."""
        if self.home_n is not None:
            away = math.hypot(p_n[0] - self.home_n[0], p_n[1] - self.home_n[1])
            if 0.0 < self.max_horizontal_m <= away:
                return "Geofence: exceeding maximum distance to Home"
            if 0.0 < self.max_vertical_m <= self.home_n[2] - p_n[2]:
                return "Geofence: exceeding maximum altitude above Home"
        if not all(area.holds((p_n[0], p_n[1])) for area in self.areas):
            return "Geofence: approaching or outside geofence"
        return ""


def usable(found: list[Area], home: Point | None, here: Point | None) -> tuple[tuple[Area, ...], list[str]]:
    """The areas that can hold, and why the others are dropped. here: of a vehicle in the air, else None."""
    kept, why = [], []
    for area in found:
        if home is not None and not area.holds(home):
            why.append("Geofence invalid, doesn't contain Home position")
        elif here is not None and not area.holds(here):
            why.append("Geofence invalid, doesn't contain current vehicle position")
        else:
            kept.append(area)
    return tuple(kept), why
