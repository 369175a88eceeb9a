"""Torque and force of one rotor of a multirotor, from its position and direction. Pure, without numpy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.errors import InputError

SPIN = {"ccw": 1.0, "cw": -1.0}
"""Sense of the reaction torque on the body about its z axis, by the rotor's direction."""


def actuator_effect(rotor: Mapping[str, Any], *, moment_ratio_m: float) -> tuple[float, float, float, float]:
    """Return torque x, y, z [m] and force z [-] of one rotor per unit of thrust [FRD].

    The thrust T pushes along -z at position r: torque r x (0, 0, -T) = (-y T, x T, 0). The reaction torque
    turns the body
    against the rotor: a rotor that turns counter-clockwise seen from above turns the body clockwise, +z.

    Raises InputError if the rotor's direction is not cw or ccw.
    """
    x, y, _ = rotor["position_m"]
    if rotor["direction"] not in SPIN:
        raise InputError(f"direction: got {rotor['direction']!r}, expected cw or ccw")
    return -y, x, moment_ratio_m * SPIN[rotor["direction"]], -1.0
