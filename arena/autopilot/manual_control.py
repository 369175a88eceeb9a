"""Manual control of one vehicle: stick positions, their source (RC or joystick), and stick gestures. Pure.

The rules are those of PX4 v1.16. Stick positions come from a radio or from a joystick, and COM_RC_IN_MODE selects the source.
The source in use stays in use until it is lost, so that two people cannot move the sticks of one vehicle at the same time.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import Literal

from arena.wire.sticks import CENTRED, Sticks

ManualControlSource = Literal["radio", "joystick"]
Gesture = Literal["", "arm", "disarm"]

RADIO, JOYSTICK, EITHER, FIRST, NO_MANUAL_CONTROL = range(5)
"""Values of COM_RC_IN_MODE. FIRST selects the source that was received first."""
_MOTION_FILTER_S = 0.1  # time constant of the filter of the sticks' speed
_CENTRE, _LOW, _ASIDE = 0.1, -0.8, 0.9  # limits of the gestures


@dataclass(frozen=True, slots=True, kw_only=True)
class ManualInput:
    """Stick positions of one vehicle at one step, and the stick gesture (arm, disarm) that the pilot has completed.

    sticks: positions from the source in use; None if manual control is lost or was never received
    speed: greatest speed of the four sticks, filtered [1/s]; at 1 a stick moves from the centre to its end in 1 s
    gesture: gesture that was completed in this step, "" for none
    """

    sticks: Sticks | None = None
    speed: float = 0.0
    gesture: Gesture = ""


NOTHING_RECEIVED = ManualInput()


class ManualControl:
    """Stick positions that a vehicle has received by radio and from a joystick.

    radio: time of the last RC_CHANNELS_OVERRIDE or of the last sample of the simulated radio [s]
    joystick: time of the last MANUAL_CONTROL [s]
    """

    def __init__(self) -> None:
        self.radio = self.joystick = -math.inf
        self._sticks: dict[ManualControlSource, Sticks] = {}
        self._first: ManualControlSource | None = None
        self._in_use: ManualControlSource | None = None
        self._last: tuple[float, Sticks] | None = None
        self._speeds = [0.0] * 4
        self._gesture_since: tuple[Gesture, float] = ("", math.inf)

    def receive(self, source: ManualControlSource, now: float, sticks: Sticks = CENTRED) -> None:
        """Store stick positions that were received at time `now`.

        source: `radio` or `joystick`
        now: time since boot [s]
        """
        setattr(self, source, now)
        self._sticks[source] = sticks
        self._first = self._first or source

    def sticks_of(self, source: ManualControlSource) -> Sticks:
        """Return the newest stick positions from a source; centred sticks if none were received."""
        return self._sticks.get(source, CENTRED)

    def is_available(self, now: float, in_mode: int, loss_s: float) -> bool:
        """Return whether stick positions were received in the last `loss_s` seconds.

        in_mode: value of COM_RC_IN_MODE, which selects the source (radio or joystick)
        loss_s: value of COM_RC_LOSS_T [s]
        """
        return bool(self._available(now, in_mode, loss_s))

    def update(self, now: float, in_mode: int, loss_s: float, gesture_s: float) -> ManualInput:
        """Return the stick positions and the gesture of this step. Call this once per step.

        gesture_s: value of COM_RC_ARM_HYST: time for which the sticks must stay in the position of a gesture [s]
        """
        if self._first is None:
            return NOTHING_RECEIVED
        available = self._available(now, in_mode, loss_s)
        if self._in_use not in available:
            self._in_use = available[0] if available else None
        if self._in_use is None:
            self._last, self._speeds, self._gesture_since = None, [0.0] * 4, ("", math.inf)
            return NOTHING_RECEIVED
        sticks = self._sticks[self._in_use]
        self._measure_speed(sticks, now)
        speed = max(map(abs, self._speeds))
        return ManualInput(
            sticks=sticks, speed=speed, gesture=self._completed_gesture(sticks, now, gesture_s)
        )

    def _available(self, now: float, in_mode: int, loss_s: float) -> list[ManualControlSource]:
        times: dict[ManualControlSource, float] = {"radio": self.radio, "joystick": self.joystick}
        counts: dict[int, tuple[ManualControlSource | None, ...]] = {
            RADIO: ("radio",),
            JOYSTICK: ("joystick",),
            EITHER: ("radio", "joystick"),
            FIRST: (self._first,),
        }
        return [s for s in counts.get(in_mode, ()) if s is not None and now - times[s] <= loss_s]

    def _measure_speed(self, sticks: Sticks, now: float) -> None:
        values = astuple(sticks)
        if self._last is not None and now > self._last[0]:
            before, dt = astuple(self._last[1]), now - self._last[0]
            share = dt / (dt + _MOTION_FILTER_S)
            for k in range(4):
                self._speeds[k] += share * ((values[k] - before[k]) / dt - self._speeds[k])
        self._last = now, sticks

    def _completed_gesture(self, sticks: Sticks, now: float, gesture_s: float) -> Gesture:
        gesture, since = _gesture_of(sticks), self._gesture_since
        if gesture != since[0]:
            self._gesture_since = gesture, now
        elif gesture and now - since[1] >= gesture_s:
            self._gesture_since = gesture, math.inf  # completed once, until the sticks leave the position
            return gesture
        return ""


def _gesture_of(sticks: Sticks) -> Gesture:
    """Return the gesture that the sticks form: arm, disarm, or "" for none.

    Arm: throttle low, yaw right. Disarm: throttle low, yaw left. Roll and pitch are centred in both.
    """
    if abs(sticks.pitch) >= _CENTRE or abs(sticks.roll) >= _CENTRE or sticks.throttle >= _LOW:
        return ""
    return "arm" if sticks.yaw > _ASIDE else "disarm" if sticks.yaw < -_ASIDE else ""
