"""Failures that a client injects into one vehicle with MAV_CMD_INJECT_FAILURE.

PX4 v1.16 SITL sends no acknowledgement for a unit or type that it does not support. The built-in autopilot
acknowledges every command.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
_OK, _OFF = mavlink.FAILURE_TYPE_OK, mavlink.FAILURE_TYPE_OFF
_UNUSED_SENSORS = (mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_UNIT_SENSOR_MAG)
_MAX_MOTORS = 12


@dataclass(slots=True)
class InjectedFailures:
    """Failures that clients have injected into one vehicle and that are active now.

    baro, vision: True if the barometer or external vision gives no data
    battery: True if the battery is reported as empty
    motors: indices of the stopped motors"""

    baro: bool = False
    vision: bool = False
    battery: bool = False
    motors: frozenset[int] = frozenset()

    def inject(self, p: Sequence[float], *, enabled: bool) -> int:
        """Inject or clear one failure and return the MAV_RESULT.

        p: FAILURE_UNIT, FAILURE_TYPE (OK or OFF) and instance, 0 for all instances
        enabled: whether SYS_FAILURE_EN allows failures
        """
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
        elif unit == mavlink.FAILURE_UNIT_SYSTEM_MOTOR and 0 <= instance <= _MAX_MOTORS:
            which = frozenset(range(_MAX_MOTORS)) if instance == 0 else frozenset({instance - 1})
            self.motors = self.motors | which if off else self.motors - which
        elif unit not in _UNUSED_SENSORS:
            return UNSUPPORTED
        return ACCEPTED
