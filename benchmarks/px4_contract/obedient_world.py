"""World process of the contract: as `python -m arena.sim`, but the built-in autopilot obeys every sender, as PX4 does.

In an arena, the built-in autopilot refuses OFFBOARD to a program after a failsafe (docs/explanation/authority.md).
The contract compares autopilots without an arena around them.
"""

from __future__ import annotations

import sys
from typing import Any

from arena.autopilot import Autopilots
from arena.sim.__main__ import autopilots_by_kind, main
from arena.sim.autopilot_interface import AutopilotSet


def obedient(settings: dict[str, Any], dt: float) -> AutopilotSet:
    """Return the autopilots of a world, without the check of who may command a vehicle.

    settings: slice of the world. dt: period of a step [s].
    """
    autopilots = autopilots_by_kind(settings, dt)
    if isinstance(autopilots, Autopilots):
        autopilots.gates = []
        for interface in autopilots.interfaces:
            interface.gate = None
    return autopilots


if __name__ == "__main__":
    sys.exit(main(make_autopilots=obedient))
