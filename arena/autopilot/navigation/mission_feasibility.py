"""Feasibility checks of an uploaded mission: the checks and texts of PX4 v1.16 for a multirotor. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.navigation.geofence import Fence
from arena.autopilot.navigation.mission_items import Item, Origin, position_of

_VTOL = (mavlink.MAV_CMD_NAV_VTOL_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_LAND, mavlink.MAV_CMD_DO_VTOL_TRANSITION)
# PX4 accepts these in an upload but rejects the mission.
_UNSUPPORTED = (
    mavlink.MAV_CMD_CONDITION_DELAY,
    mavlink.MAV_CMD_CONDITION_DISTANCE,
    mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT,
)
_MOVES = (
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
    mavlink.MAV_CMD_NAV_LAND,
    mavlink.MAV_CMD_NAV_TAKEOFF,
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
)


def moves(item: Item) -> bool:
    """Return whether a mission item has a position to fly to."""
    return item.has_position and item.command in _MOVES


def why_infeasible(
    items: Sequence[Item],
    origin: Origin,
    home_n: tuple[float, float, float],
    fence: Fence,
    *,
    landed: bool,
    max_first_distance_m: float,
    required_items: int,
) -> str:
    """Return the first reason to reject a mission; "" if the mission is feasible.

    items: items of the mission
    origin: place and direction of the local frame on Earth
    home_n: home position [m] [NED]
    fence: active geofence
    landed: whether the vehicle is on the ground
    max_first_distance_m: value of MIS_DIST_1WP [m]
    required_items: value of MIS_TKO_LAND_REQ
    """
    return (
        _items(items, origin, home_n, landed=landed)
        or _distance(items, origin, home_n, max_first_distance_m)
        or _required(items, required_items)
        or _fenced(items, origin, home_n, fence)
    )


def _items(
    items: Sequence[Item],
    origin: Origin,
    home_n: tuple[float, float, float],
    *,
    landed: bool,
) -> str:
    positioned = False
    for k, item in enumerate(items):
        height = home_n[2] - position_of(item, origin, home_n[2])[2]
        why = _item(item, k, height, landed=landed, positioned=positioned)
        if why:
            return why
        positioned |= item.has_position
    return ""


def _item(item: Item, k: int, height: float, *, landed: bool, positioned: bool) -> str:
    takeoff = item.command in (mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF)
    if item.command in _UNSUPPORTED:
        return f"Mission rejected: item {k + 1}: unsupported cmd: {item.command}"
    if k == 0 and item.command == mavlink.MAV_CMD_NAV_LAND and landed:
        return "Mission rejected: starts with landing"
    if takeoff and height <= 0.0:
        return "Mission rejected: Takeoff altitude below home altitude!"
    if takeoff and positioned:
        return "Mission rejected: takeoff not first waypoint item"
    if item.command in _VTOL:
        return "Mission rejected: Mission contains VTOL items but vehicle is not a VTOL"
    return ""


def _distance(
    items: Sequence[Item],
    origin: Origin,
    home_n: tuple[float, float, float],
    most_m: float,
) -> str:
    first = next((item for item in items if moves(item)), None)
    if first is None or most_m <= 0.0:
        return ""
    n, e, _ = position_of(first, origin, home_n[2])
    away = math.hypot(n - home_n[0], e - home_n[1])
    return (
        f"First waypoint far away from home: {away:.0f}m. Correct mission loaded?" if away >= most_m else ""
    )


def _required(items: Sequence[Item], wanted: int) -> str:
    takeoff = any(item.command == mavlink.MAV_CMD_NAV_TAKEOFF for item in items)
    land = any(item.command == mavlink.MAV_CMD_NAV_LAND for item in items)
    if wanted == 1 and not takeoff:
        return "Mission rejected: Takeoff waypoint required."
    if wanted == 2 and not land:
        return "Mission rejected: Landing waypoint/pattern required."
    if wanted == 3 and not (takeoff and land):
        return "Mission rejected: Takeoff or Landing item missing."
    if wanted in (4, 5) and takeoff != land:
        add, remove = ("Landing", "Takeoff") if takeoff else ("Takeoff", "Landing")
        return f"Mission rejected: Add {add} item or remove {remove}."
    return ""


def _fenced(
    items: Sequence[Item],
    origin: Origin,
    home_n: tuple[float, float, float],
    fence: Fence,
) -> str:
    for k, item in enumerate(items):
        if moves(item) and fence.breach(position_of(item, origin, home_n[2])):
            return f"Geofence violation for waypoint {k + 1}"
    return ""
