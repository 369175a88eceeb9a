"""Geofence of one vehicle: uploaded polygons and circles, and maximum distances from home. Pure.

The commander runs the reaction to a breach (GF_ACTION).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.navigation.mission_items import FENCE_COMMANDS, POLYGONS, Item, Origin, local

Point = tuple[float, float]
_INCLUSIONS = (mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION)


@dataclass(frozen=True, slots=True, kw_only=True)
class Area:
    """Polygon or circle of a geofence.

    corners: north, east [m] of each corner; for a circle, of its centre
    radius_m: radius of a circle [m]
    inside: True if the vehicle must stay inside, False if it must stay outside
    """

    corners: tuple[Point, ...]
    radius_m: float
    inside: bool

    def allows(self, p: Point) -> bool:
        """Return whether this area of the geofence allows a point: inside an inclusion, or outside an exclusion.

        p: north, east [m]
        """
        return (self._in_circle(p) if len(self.corners) == 1 else self._in_polygon(p)) == self.inside

    def _in_circle(self, p: Point) -> bool:
        return math.dist(p, self.corners[0]) < self.radius_m

    def _in_polygon(self, p: Point) -> bool:
        """Return whether a point is inside the polygon, by the Jordan curve theorem.

        A point is inside if an odd number of edges lies north of the point.
        """
        crossings = 0
        for (n1, e1), (n2, e2) in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            if (e1 > p[1]) != (e2 > p[1]) and p[0] < n1 + (n2 - n1) * (p[1] - e1) / (e2 - e1):
                crossings += 1
        return crossings % 2 == 1


def read_areas(items: Sequence[Item], origin: Origin) -> list[Area]:
    """Return the polygons and circles of an uploaded fence.

    If corners of a polygon are missing, use the received corners.

    origin: place and direction of the local frame on Earth
    """
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
    """Geofence that is in force for one vehicle: its areas, and the maximum distances from home.

    home_n: home position [m] [NED], None if not set
    max_horizontal_m, max_vertical_m: maximum distances from home [m], 0 for no limit
    """

    areas: tuple[Area, ...] = ()
    home_n: tuple[float, float, float] | None = None
    max_horizontal_m: float = 0.0
    max_vertical_m: float = 0.0

    def breach(self, p_n: Sequence[float]) -> str:
        """Return PX4's text for the geofence rule that a position violates; "" for none.

        p_n: position [m] [NED]
        """
        if self.home_n is not None:
            away = math.hypot(p_n[0] - self.home_n[0], p_n[1] - self.home_n[1])
            if 0.0 < self.max_horizontal_m <= away:
                return "Geofence: exceeding maximum distance to Home"
            if 0.0 < self.max_vertical_m <= self.home_n[2] - p_n[2]:
                return "Geofence: exceeding maximum altitude above Home"
        if not all(area.allows((p_n[0], p_n[1])) for area in self.areas):
            return "Geofence: approaching or outside geofence"
        return ""


def usable_areas(
    found: list[Area], home: Point | None, here: Point | None
) -> tuple[tuple[Area, ...], list[str]]:
    """Return the valid polygons and circles of a geofence, and PX4's text for each invalid one.

    As in PX4, an area is invalid if it forbids the home position or the vehicle's position.

    home: north, east [m], None if not set
    here: north, east [m] of a vehicle in flight, None on the ground
    """
    kept, reasons = [], []
    for area in found:
        if home is not None and not area.allows(home):
            reasons.append("Geofence invalid, doesn't contain Home position")
        elif here is not None and not area.allows(here):
            reasons.append("Geofence invalid, doesn't contain current vehicle position")
        else:
            kept.append(area)
    return tuple(kept), reasons
