"""A pilot's sticks as far as the autopilot knows them: there, or not. COM_RC_IN_MODE says which of what is heard counts. Pure.

Nobody flies by them here, and moving them takes nothing over: they are always in the middle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Source = Literal["radio", "joystick"]

RADIO, JOYSTICK, BOTH, FIRST, NONE = range(5)
"""COM_RC_IN_MODE: FIRST keeps to the one that was heard first."""


@dataclass(slots=True)
class Sticks:
    """When each source was heard last [s]. A radio is the simulated one or RC_CHANNELS_OVERRIDE, a joystick MANUAL_CONTROL."""

    radio: float = -math.inf
    joystick: float = -math.inf
    _first: Source | None = None

    def hear(self, source: Source, now: float) -> None:
        setattr(self, source, now)
        self._first = self._first or source

    def there(self, now: float, in_mode: int, loss_s: float) -> bool:
        """in_mode: COM_RC_IN_MODE; loss_s: COM_RC_LOSS_T."""
        radio, joystick = now - self.radio <= loss_s, now - self.joystick <= loss_s
        first = radio if self._first == "radio" else joystick
        return {RADIO: radio, JOYSTICK: joystick, BOTH: radio or joystick, FIRST: first}.get(in_mode, False)
