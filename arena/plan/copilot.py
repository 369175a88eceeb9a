"""The slice of the copilot: its rules, and what it must know of each vehicle. Pure."""

from __future__ import annotations

from typing import Any

from arena.plan import rooms
from arena.plan.firmware import Fleet
from arena.schema import Arena, Vehicle
from arena.schema.copilot import RULES

Json = dict[str, Any]

# PX4's own defaults of what limits a stop in AUTO modes
_BRAKING = {
    "accel": ("MPC_ACC_HOR", 3.0),
    "jerk": ("MPC_JERK_AUTO", 4.0),
    "up": ("MPC_ACC_DOWN_MAX", 3.0),
    "down": ("MPC_ACC_UP_MAX", 4.0),
}


def copilot(arena: Arena, fleet: Fleet) -> Json:
    c = arena.copilot
    if c is None:
        raise ValueError("this arena has no copilot")
    return {
        "name": "copilot",
        "listen": rooms.heart(arena),
        "escalate_after_s": c.escalate_after_s,
        "at_most": c.at_most,
        "rules": {rule: getattr(c, rule).model_dump() for rule in RULES},
        "latency_s": arena.mocap.latency_ms / 1000.0,
        "clock": None if arena.hardware else rooms.CLOCK,
        "captures": _captures(arena),
        "vehicles": [_vehicle(arena, v, fleet) for v in arena.vehicles],
    }


def _vehicle(arena: Arena, v: Vehicle, fleet: Fleet) -> Json:
    panic = rooms.link_of(arena, v, "panic")
    braking = {key: fleet[v.name].values.get(name, default) for key, (name, default) in _BRAKING.items()}
    return {
        "name": v.name,
        "id": v.id,
        "body": v.mocap_body,
        "simulated": v.simulated,
        "poses": v.forward,
        "tools": [arena.address, v.ports.tools],
        "panic": [panic.autopilot_host, panic.autopilot_port],
        "fence": arena.geofence.slice() if arena.geofence is not None else _walls(arena, v),
        "braking": braking,
    }


def _walls(arena: Arena, v: Vehicle) -> Json:
    """Of the room, less the vehicle's own size: where its centre may be."""
    (north, east, up), radius = arena.world.size, v.profile.radius_m
    n, e = north / 2.0 - radius, east / 2.0 - radius
    return {"north": [-n, n], "east": [-e, e], "up": up - v.profile.height_m / 2.0}


def _captures(arena: Arena) -> list[Json]:
    """One receiver for each server that sees some of the vehicles."""
    found = []
    for simulated in (True, False):
        bodies = [v.mocap_body for v in arena.vehicles if v.simulated is simulated]
        one = rooms.capture(arena, bodies, simulated=simulated) if bodies else None
        found += [one] if one is not None else []
    return found
