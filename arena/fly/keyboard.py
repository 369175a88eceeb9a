"""Converts keys that are pressed in a terminal to stick positions and actions, for `arena fly`. Pure.

A terminal reports pressed keys, but not released keys. A key therefore deflects its stick until it is not repeated any more.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from arena.wire.sticks import Sticks

FIRST_HOLD_S = 0.6
"""Deflection after the first press [s]: longer than the time until keyboards repeat a key."""
REPEAT_HOLD_S = 0.2
"""Deflection after each repetition [s]."""
STEP, LEAST, MOST = 0.1, 0.2, 1.0
"""Change and limits of the deflection of the right stick and of the yaw stick, by the keys + and - [-]."""

_ESCAPES = {b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left"}
_ESCAPES |= {key.replace(b"[", b"O"): name for key, name in _ESCAPES.items()}
_CLIMB = 0.7  # enough to take off, and a slow climb rate for a room
_AXES = {
    "w": ("throttle", _CLIMB),
    "s": ("throttle", -1.0),
    "a": ("yaw", -1.0),
    "d": ("yaw", 1.0),
    "up": ("pitch", 1.0),
    "down": ("pitch", -1.0),
    "left": ("roll", -1.0),
    "right": ("roll", 1.0),
}
ACTIONS = {
    "1": "POSCTL",
    "2": "ALTCTL",
    "3": "STABILIZED",
    "4": "ACRO",
    "h": "AUTO.LOITER",
    "l": "AUTO.LAND",
    "o": "OFFBOARD",
    "r": "arm",
    "x": "disarm",
    "q": "quit",
    "\x03": "quit",  # Ctrl-C of a terminal that does not turn it into a signal
}
"""Key -> requested mode, or `arm`, `disarm`, `quit`."""
HELP = """\
  w s   climb, descend        arrows  forward, back, left, right
  a d   turn left, right      space   release all sticks          + -  less, more deflection
  1 POSCTL  2 ALTCTL  3 STABILIZED  4 ACRO  h hold  l land  o back to the program (OFFBOARD)
  r arm (in POSCTL)   x disarm (on the ground)   q or Ctrl-C  land and quit; again: quit at once"""


def parse_keys(data: bytes) -> list[str]:
    """Convert bytes from a terminal to names of pressed keys: characters, `up`, `down`, `left`, `right`.

    Other escape codes are left out.
    """
    keys, at = [], 0
    while at < len(data):
        if data[at : at + 1] == b"\x1b":
            name = _ESCAPES.get(data[at : at + 3])
            keys += [name] if name else []
            at += 3
        else:
            keys.append(data[at : at + 1].decode("latin-1").lower())
            at += 1
    return keys


@dataclass(slots=True)
class Keyboard:
    """Sticks of `arena fly` without a gamepad: each pressed key deflects a stick for a short time.

    deflection: deflection of the right stick and of the yaw stick while a key is pressed 0..1. The keys + and - do not change the
        deflection of the throttle stick
    """

    deflection: float = 0.5
    _pressed: dict[str, tuple[float, float]] = field(default_factory=dict)  # axis -> position, end [s]

    def press(self, key: str, now: float) -> str:
        """Process a pressed key. Return the requested action, such as `arm` (see `ACTIONS`); "" for none.

        now: monotonic [s].
        """
        if key in _AXES:
            self._deflect(*_AXES[key], now)
        elif key == " ":
            self._pressed.clear()
        elif key in "+=":
            self.deflection = min(MOST, self.deflection + STEP)
        elif key in "-_":
            self.deflection = max(LEAST, self.deflection - STEP)
        return ACTIONS.get(key, "")

    def sticks(self, now: float) -> Sticks:
        """Return the stick positions at the time `now` (monotonic) [s]."""
        self._pressed = {axis: at for axis, at in self._pressed.items() if at[1] > now}
        positions = {axis: position for axis, (position, _) in self._pressed.items()}
        return Sticks(**positions)

    def _deflect(self, axis: str, direction: float, now: float) -> None:
        position = direction * (1.0 if axis == "throttle" else self.deflection)  # signed
        last = self._pressed.get(axis)
        repeated = last is not None and last[1] > now and last[0] * direction > 0.0
        self._pressed[axis] = position, now + (REPEAT_HOLD_S if repeated else FIRST_HOLD_S)
