"""Makes the configuration file (slice) of the copilot, the process that monitors all vehicles.

If a vehicle violates a safety rule of the YAML, the copilot commands hold, land or terminate. Pure.
"""

from __future__ import annotations

from arena.plan import slices
from arena.plan.job import Job, Json, link_of
from arena.schema import Arena, Vehicle
from arena.schema.copilot import RULES

# Parameters that limit a stop in AUTO modes, with their PX4 defaults
_BRAKING = {
    "accel": ("MPC_ACC_HOR", 3.0),
    "jerk": ("MPC_JERK_AUTO", 4.0),
    "up": ("MPC_ACC_DOWN_MAX", 3.0),
    "down": ("MPC_ACC_UP_MAX", 4.0),
}


def copilot(job: Job) -> Json:
    """Return the JSON configuration (slice) of the copilot."""
    arena = job.arena
    c = arena.copilot
    if c is None:
        raise ValueError("cannot make the configuration of the copilot: this arena has no copilot")
    return {
        "name": "copilot",
        "listen": slices.heartbeat_address(arena),
        "escalate_after_s": c.escalate_after_s,
        "at_most": c.at_most,
        "rules": {rule: getattr(c, rule).as_dict() for rule in RULES},
        "latency_s": arena.mocap.latency_ms / 1000.0,
        "clock": None if arena.hardware else slices.CLOCK,
        "captures": _captures(arena),
        "vehicles": [_vehicle(job, v) for v in arena.vehicles],
    }


def _vehicle(job: Job, v: Vehicle) -> Json:
    arena = job.arena
    panic = link_of(arena, v, "panic")
    values = job.fleet[v.name].values
    braking = {key: values.get(name, default) for key, (name, default) in _BRAKING.items()}
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
    """Return the box in which the vehicle's centre must stay, so that the vehicle does not touch a wall.

    While the centre is in this box, the vehicle's body does not touch the room's walls. The lengths are in
    metres.
    """
    (north, east, up), radius = arena.world.size, v.profile.radius_m
    n, e = north / 2.0 - radius, east / 2.0 - radius
    return {"north": [-n, n], "east": [-e, e], "up": up - v.profile.height_m / 2.0}


def _captures(arena: Arena) -> list[Json]:
    """Return the settings of the copilot's motion-capture receivers, one per server.

    A server that sees no vehicle has no receiver.
    """
    found = []
    for simulated in (True, False):
        bodies = [v.mocap_body for v in arena.vehicles if v.simulated is simulated]
        one = slices.capture(arena, bodies, simulated=simulated) if bodies else None
        found += [one] if one is not None else []
    return found
