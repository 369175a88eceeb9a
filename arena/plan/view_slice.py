"""Makes the configuration file (slice) of viewers, which are programs that show a running arena. Pure.

No process of the arena reads it. `arena monitor` and `arena top` read it from the run folder.
"""

from __future__ import annotations

from arena.plan import slices
from arena.plan.job import Json
from arena.schema import Arena, Vehicle

NAME = "view.json"


def view(arena: Arena) -> Json:
    """Return the JSON configuration (slice) of the viewers of an arena."""
    has_world = bool(arena.simulated)
    return {
        "name": "view",
        "size_m": list(arena.world.size),
        "ceiling": arena.world.ceiling,
        "obstacles": [o.slice() for o in arena.obstacles],
        "fence": None if arena.geofence is None else arena.geofence.slice(),
        "clock": slices.CLOCK if has_world else None,
        "truth": slices.TRUTH if has_world else None,
        "paths": slices.PATHS,
        "captures": _captures(arena),
        "vehicles": [_vehicle(arena, v) for v in arena.vehicles],
    }


def _vehicle(arena: Arena, v: Vehicle) -> Json:
    return {
        "name": v.name,
        "id": v.id,
        "autopilot": v.autopilot,
        "simulated": v.simulated,
        "index": arena.simulated.index(v) if v.simulated else None,
        "body": v.mocap_body,
        "tools": [arena.address, v.ports.tools],
        "start": list(v.position),
        "offboard_loss_s": v.own_params.get("COM_OF_LOSS_T", arena.failsafe.offboard_loss.after_s),
        "profile": v.profile.name,
        "radius_m": v.profile.radius_m,
        "height_m": v.profile.height_m,
        "rotors": [{"position_m": list(r.position_m), "direction": r.direction} for r in v.profile.rotors],
    }


def _captures(arena: Arena) -> list[Json]:
    """Return the settings of the motion-capture receivers with which viewers get poses of real vehicles.

    The list has one entry, or is empty if no server sees real vehicles.

    Simulated vehicles need none: their true state is in shared memory.
    """
    bodies = [v.mocap_body for v in arena.vehicles if not v.simulated]
    one = slices.capture(arena, bodies, simulated=False) if bodies else None
    return [] if one is None else [one]
