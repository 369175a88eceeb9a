"""The process `world`: `python -m arena.sim FILE.json`. It also contains the built-in autopilots.

This is the only module that connects the world with the built-in autopilot and with the PX4 links.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from arena.errors import ArenaError
from arena.process_context import ProcessContext
from arena.sim.autopilot_interface import AutopilotSet, CompositeAutopilots, MakeAutopilots
from arena.sim.loop import run
from arena.sim.sensors import hil_outputs
from arena.sim.vehicle_links import VehicleLinks


def main(argv: list[str] | None = None, make_autopilots: MakeAutopilots | None = None) -> int:
    """Run the world as a separate process with UDP links until a stop is requested. Return its exit code.

    argv: command line; it names the JSON configuration (slice) of the process
    make_autopilots: creates the autopilots; by default the configuration file selects their kinds
    """
    try:
        context = ProcessContext.enter(argv)
        run(context, context.settings, make_autopilots or autopilots_by_kind, _udp_links)
    except ArenaError as error:
        print(f"arena world: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def _udp_links(_: ProcessContext, settings: Mapping[str, Any], budget_s: float, *__: object) -> VehicleLinks:
    return VehicleLinks(settings["vehicles"], budget_s=budget_s)


def autopilots_by_kind(settings: dict[str, Any], dt: float) -> AutopilotSet:
    """Create the autopilots of all vehicles: built-in autopilots, or connections to PX4."""
    vehicles = settings["vehicles"]
    kinds = [v.get("autopilot", "builtin") for v in vehicles]
    for kind, make in (("builtin", _builtin), ("px4", _px4)):
        if all(k == kind for k in kinds):
            return make(settings, dt)
    parts: list[tuple[Any, AutopilotSet]] = []
    for kind, make in (("builtin", _builtin), ("px4", _px4)):
        rows = np.array([i for i, k in enumerate(kinds) if k == kind], int)
        if len(rows):
            parts.append((rows, make({**settings, "vehicles": [vehicles[i] for i in rows]}, dt)))
    return CompositeAutopilots(parts, len(vehicles), max(len(v["profile"]["rotors"]) for v in vehicles))


def _builtin(settings: dict[str, Any], dt: float) -> AutopilotSet:
    from arena.autopilot import Autopilots, UlogFiles

    folder = settings.get("ulog")
    files = UlogFiles(Path(folder)) if folder else None
    if settings.get("speed") == 1.0:  # a faster flight is repeatable, so its date must not be the computer's
        settings = {**settings, "boot_unix_us": time.time_ns() // 1000}
    return Autopilots(settings, dt, authority=True, ulog=files, library=files)


def _px4(settings: dict[str, Any], dt: float) -> AutopilotSet:
    from arena.px4.lockstep import Px4Links

    origin = settings.get("origin")
    return Px4Links(
        settings["vehicles"],
        (origin["lat_deg"], origin["lon_deg"], origin["alt_m"]) if origin else None,
        hil_outputs(),
    )


if __name__ == "__main__":
    sys.exit(main())
