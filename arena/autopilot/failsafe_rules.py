"""Tables for failsafe decisions: order of severity of the modes, bits of COM_*_EXCEPT, manual modes. Pure."""

from __future__ import annotations

from arena.autopilot.commander_inputs import CommanderInputs
from arena.autopilot.flight_modes import Mode

EXCEPTION_BIT = {Mode.MISSION: 1, Mode.HOLD: 2, Mode.TAKEOFF: 2, Mode.OFFBOARD: 4}
"""Mode -> its bit of COM_DLL_EXCEPT and COM_RCL_EXCEPT."""
BY_SEVERITY = (Mode.HOLD, Mode.RTL, Mode.LAND, Mode.DESCEND, Mode.TERMINATE)
"""Modes of failsafes. The one that is later in this list has priority."""
MANUAL_ACTIONS = {0: Mode.POSCTL, 1: Mode.ALTCTL, 2: Mode.STABILIZED}
"""Value of COM_OBL_RC_ACT -> mode."""
NOT_ARMABLE = {Mode.RTL, Mode.LAND, Mode.DESCEND, Mode.TERMINATE}
"""Modes in which a vehicle cannot be armed."""


def home_or_land(s: CommanderInputs) -> Mode:
    """Return mode RTL if position, home position and origin are valid, else LAND."""
    return Mode.RTL if s.global_ok and s.home_ok and s.position_ok else Mode.LAND
