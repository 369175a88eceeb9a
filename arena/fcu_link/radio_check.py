"""Preflight check of the pilot's RC: it must be received, and its kill switch must have been tested. Pure.

What PX4 (v1.9 to v1.18) reports about the transmitter, and what this check uses:

- SYS_STATUS: the sensor RC_RECEIVER is present while the source of manual control that COM_RC_IN_MODE selects sends;
- RC_CHANNELS: the raw channels of the RC receiver, so that a joystick alone does not count;
- HEARTBEAT: system_status is FLIGHT_TERMINATION while the kill switch is on; a disarmed vehicle has no other cause of it;
- the parameters RC_MAP_KILL_SW and COM_RC_IN_MODE.

A kill switch that is on when PX4 starts is not reported in the HEARTBEAT, because PX4 reacts to a change of the switch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.px4_mode import mode_words

KILL_CHANNEL, SOURCE = "RC_MAP_KILL_SW", "COM_RC_IN_MODE"
_MAX_AGE_S = 3.0  # SYS_STATUS and RC_CHANNELS are requested at 2 Hz
_RC = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER


class RadioCheck:
    """Preflight check of one vehicle's RC transmitter and its kill switch.

    Pass the autopilot's messages to `on_autopilot`. `reasons` returns why the vehicle must not be armed.
    modes: values of COM_RC_IN_MODE with which the transmitter works; None if no transmitter is required.
    """

    def __init__(self, modes: Sequence[int] | None) -> None:
        self._modes = tuple(modes or ())
        self.required = modes is not None
        self.reset()

    @property
    def params(self) -> tuple[str, ...]:
        """Names of the PX4 parameters that the RC check reads; empty if no transmitter is required."""
        return (KILL_CHANNEL, SOURCE) if self.required else ()

    def reset(self) -> None:
        """Delete the state of the RC and the result of the kill switch test.

        The autopilot has rebooted or was exchanged.
        """
        self._status_at = self._channels_at = -math.inf
        self._present = self._healthy = False
        self._killed = self._tested = False

    def on_autopilot(self, m: Any, now: float) -> None:
        """Update the state of RC and kill switch from a message of the vehicle's autopilot. now: time [s]."""
        kind = m.get_type()
        if kind == "SYS_STATUS":
            self._status_at = now
            self._present = bool(m.onboard_control_sensors_present & m.onboard_control_sensors_enabled & _RC)
            self._healthy = bool(m.onboard_control_sensors_health & _RC)
        elif kind == "RC_CHANNELS" and m.chancount > 0:
            self._channels_at = now
        elif kind == "HEARTBEAT":
            self._on_heartbeat(m, now)

    def _on_heartbeat(self, m: Any, now: float) -> None:
        """Record that the pilot of a disarmed vehicle has switched the kill switch on and off again.

        The switch counts as on only while RC is received.
        """
        on = m.system_status == mavlink.MAV_STATE_FLIGHT_TERMINATION
        if m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED or mode_words(m.custom_mode) == "TERMINATION":
            self._killed = False
        elif on:
            self._killed = self._received(now)
        elif self._killed:
            self._killed, self._tested = False, True

    def _received(self, now: float) -> bool:
        return self._present and now - min(self._status_at, self._channels_at) <= _MAX_AGE_S

    def reasons(self, now: float, params: Mapping[str, float | None]) -> list[str]:
        """Return why the RC forbids arming; empty if arming is allowed.

        Each text fits in one STATUSTEXT.

        params: values of the parameters `params` in the vehicle. None: not read yet; NaN: the vehicle does not have the parameter.
        """
        if not self.required:
            return []
        found = list(self._setup(params))
        if not self._received(now):
            return [*found, "no RC signal: is the transmitter on?"]
        if self._killed:
            return [*found, "kill switch is on"]
        if not self._healthy:
            found.append("autopilot reports an RC fault")
        return found if self._tested else [*found, "test the kill switch: on for 2 s, then off"]

    def _setup(self, params: Mapping[str, float | None]) -> list[str]:
        channel, mode = params[KILL_CHANNEL], params[SOURCE]
        if channel is None or mode is None:
            return ["RC setup not read yet"]
        found = [] if 1 <= channel <= 18 else ["no kill switch: set RC_MAP_KILL_SW"]
        return (
            found if mode in self._modes else [*found, f"COM_RC_IN_MODE {mode:g} can ignore the RC switches"]
        )
