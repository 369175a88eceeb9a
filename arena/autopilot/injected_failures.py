"""MAV_CMD_INJECT_FAILURE: what a client may break in the built-in autopilot, and mend again.

PX4 v1.16 SITL knows of units and types; what it does not know it leaves unanswered. Here every command is answered: what is not
there to be broken is unsupported.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
_OK, _OFF = mavlink.FAILURE_TYPE_OK, mavlink.FAILURE_TYPE_OFF
_HARMLESS = (
    mavlink.FAILURE_UNIT_SENSOR_GPS,
    mavlink.FAILURE_UNIT_SENSOR_MAG,
)  # nothing here is made of these
_MOTORS = 12


@dataclass(slots=True)
class Failures:
    """What is broken in one vehicle. motors: by their index; any: whether anything is."""

    baro: bool = False
    vision: bool = False
    battery: bool = False
    motors: frozenset[int] = frozenset()

    @property
    def any(self) -> bool:
        return self.baro or self.vision or self.battery or bool(self.motors)

    def inject(self, p: Sequence[float], *, enabled: bool) -> int:
        """p: unit, type and instance (0 for all); enabled: SYS_FAILURE_EN. -> MAV_RESULT."""
        if not enabled:
            return DENIED
        if not all(math.isfinite(x) and abs(x) < 1000 for x in p[:3]):
            return UNSUPPORTED
        unit, kind, instance = (math.floor(x + 0.5) for x in p[:3])
        if kind not in (_OK, _OFF):
            return UNSUPPORTED
        return self._set(unit, kind == _OFF, instance)

    def _set(self, unit: int, off: bool, instance: int) -> int:
        if unit == mavlink.FAILURE_UNIT_SENSOR_BARO:
            self.baro = off
        elif unit == mavlink.FAILURE_UNIT_SENSOR_VIO:
            self.vision = off
        elif unit == mavlink.FAILURE_UNIT_SYSTEM_BATTERY and instance == 0:
            self.battery = off
        elif unit == mavlink.FAILURE_UNIT_SYSTEM_MOTOR and 0 <= instance <= _MOTORS:
            which = frozenset(range(_MOTORS)) if instance == 0 else frozenset({instance - 1})
            self.motors = self.motors | which if off else self.motors - which
        elif unit not in _HARMLESS:
            return UNSUPPORTED
        return ACCEPTED
