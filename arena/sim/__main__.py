"""`python -m arena.sim slice.json`: the world, and beside it the built-in autopilots of the vehicles it
holds.

The one place where the cores of two rooms meet.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from arena.errors import ArenaError
from arena.sim.autopilot_interface import MakePilots, Pilots
from arena.sim.composite_autopilot import Mixed
from arena.sim.loop import serve


def main(argv: list[str] | None = None, make_pilots: MakePilots | None = None) -> int:
    """make_pilots: how to make the autopilots from the slice and the period [s]; the built-in ones unless
    told otherwise.
    """
    try:
        serve(make_pilots or _by_kind, argv)
    except ArenaError as error:
        print(f"arena world: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def _by_kind(settings: dict[str, Any], dt: float) -> Pilots:
    """The built-in autopilots for the rows that ask for them, the links to PX4s for the others."""
    vehicles = settings["vehicles"]
    kinds = [v.get("autopilot", "builtin") for v in vehicles]
    for kind, make in (("builtin", _builtin), ("px4", _px4)):
        if all(k == kind for k in kinds):
            return make(settings, dt)
    parts: list[tuple[Any, Pilots]] = []
    for kind, make in (("builtin", _builtin), ("px4", _px4)):
        rows = np.array([i for i, k in enumerate(kinds) if k == kind], int)
        if len(rows):
            parts.append((rows, make({**settings, "vehicles": [vehicles[i] for i in rows]}, dt)))
    return Mixed(parts, len(vehicles), max(len(v["profile"]["rotors"]) for v in vehicles))


def _builtin(settings: dict[str, Any], dt: float) -> Pilots:
    from arena.autopilot import Autopilots

    return Autopilots(settings, dt)


def _px4(settings: dict[str, Any], dt: float) -> Pilots:
    from arena.px4.lockstep import Px4Links

    origin = settings.get("origin")
    return Px4Links(
        settings["vehicles"], (origin["lat_deg"], origin["lon_deg"], origin["alt_m"]) if origin else None
    )


if __name__ == "__main__":
    sys.exit(main())
