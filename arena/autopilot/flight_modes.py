"""Flight modes of the built-in autopilot, with PX4's numbers and names, and sets such as the manual modes. Pure."""

from __future__ import annotations

from enum import Enum

_ORBIT, _POSITION_SLOW = 1, 2  # sub modes of POSCTL that the built-in autopilot does not have


class Mode(Enum):
    """Flight mode of PX4.

    Each value contains the main mode and sub mode of PX4's custom_mode, and the name that MAVROS shows.
    """

    MANUAL = (1, 0, "MANUAL")
    ALTCTL = (2, 0, "ALTCTL")
    POSCTL = (3, 0, "POSCTL")
    TAKEOFF = (4, 2, "AUTO.TAKEOFF")
    HOLD = (4, 3, "AUTO.LOITER")
    MISSION = (4, 4, "AUTO.MISSION")
    RTL = (4, 5, "AUTO.RTL")
    LAND = (4, 6, "AUTO.LAND")
    ACRO = (5, 0, "ACRO")
    OFFBOARD = (6, 0, "OFFBOARD")
    STABILIZED = (7, 0, "STABILIZED")
    DESCEND = (4, 106, "DESCEND")  # internal: HEARTBEAT reports AUTO.LAND
    TERMINATE = (10, 0, "TERMINATION")  # cannot be requested

    __hash__ = object.__hash__  # by identity: an enum hashes its name, which is slow

    @property
    def custom_mode(self) -> int:
        """Value of the field custom_mode in HEARTBEAT."""
        main, sub, _ = self.value
        return main << 16 | (sub % 100) << 24

    @property
    def label(self) -> str:
        """Name of the mode, for example `AUTO.LAND`."""
        return self.value[2]


def mode_of(main: int, sub: int) -> Mode | None:
    """Return the flight mode with these PX4 main and sub mode numbers, or None if PX4 has no such mode."""
    if main == Mode.POSCTL.value[0] and sub in (_ORBIT, _POSITION_SLOW):
        return None
    return next((m for m in Mode if m.value[:2] == (main, sub if main == 4 else 0) and sub < 100), None)


THRUST_MODES = frozenset({Mode.MANUAL, Mode.STABILIZED, Mode.ACRO})
"""Modes in which the throttle stick sets the collective thrust. MANUAL of a multirotor is STABILIZED, as in PX4."""
MANUAL_MODES = THRUST_MODES | {Mode.ALTCTL, Mode.POSCTL}
"""Modes in which a person flies with sticks."""
POSITION_MODES = frozenset({Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RTL, Mode.LAND, Mode.POSCTL})
"""Modes that need a valid position."""
STANDARD_MODES = {
    Mode.POSCTL: 1,
    Mode.ALTCTL: 4,
    Mode.RTL: 5,
    Mode.MISSION: 6,
    Mode.LAND: 7,
    Mode.DESCEND: 7,
    Mode.TAKEOFF: 8,
}
"""MAV_STANDARD_MODE of each flight mode that has one. It is 0 for all other modes."""
