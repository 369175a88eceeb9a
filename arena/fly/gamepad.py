"""Reads a gamepad for `arena fly`: stick positions, and the actions of its buttons, such as arm and land.

The gamepad is read with pygame (SDL).

The module is imported only if a gamepad is used.

SDL knows the layout of most gamepads, so the sticks have the same names on all of them: left stick throttle and yaw, right stick
pitch and roll (the usual "mode 2" of RC transmitters).
"""

from __future__ import annotations

import os
from typing import Any

from arena.errors import InputError
from arena.wire.sticks import Sticks

_FULL = 32767
BUTTONS = {
    "a": "POSCTL",
    "b": "AUTO.LAND",
    "x": "AUTO.LOITER",
    "y": "ALTCTL",
    "start": "arm",
    "back": "disarm",
}
"""Button in SDL's layout -> requested mode, `arm` or `disarm`."""


def sticks_of_axes(left_x: int, left_y: int, right_x: int, right_y: int) -> Sticks:
    """Convert SDL's gamepad axes to stick positions.

    The axes are -32768..32767, positive to the right and down.
    """
    x, y, turn, up = (min(max(v / _FULL, -1.0), 1.0) for v in (right_x, -right_y, left_x, -left_y))
    return Sticks(roll=x, pitch=y, throttle=up, yaw=turn)


class Gamepad:
    """Gamepad of the person who flies a vehicle by hand: the first gamepad that is connected to this computer.

    Raises InputError if pygame is missing or no gamepad is connected.
    """

    def __init__(self) -> None:
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # no window is needed
        os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
            from pygame._sdl2 import controller
        except ImportError as error:
            raise InputError("--gamepad needs pygame: pip install 'flying-arena[gamepad]'") from error
        self._pygame: Any = pygame
        pygame.display.init()
        controller.init()
        found = next((k for k in range(controller.get_count()) if controller.is_controller(k)), None)
        if found is None:
            raise InputError("--gamepad: no gamepad is connected, or SDL does not know its layout")
        self._controller: Any = controller.Controller(found)
        self._pressed: set[str] = set()

    def poll(self) -> tuple[Sticks | None, list[str]]:
        """Return the stick positions, and the actions (such as `arm`) of the buttons pressed since the last call.

        The positions are None if the gamepad is disconnected.
        """
        pygame, pad = self._pygame, self._controller
        pygame.event.pump()
        if not pad.attached():
            return None, []
        names = ("LEFTX", "LEFTY", "RIGHTX", "RIGHTY")
        axes = [pad.get_axis(getattr(pygame, f"CONTROLLER_AXIS_{name}")) for name in names]
        pressed = {
            name for name in BUTTONS if pad.get_button(getattr(pygame, f"CONTROLLER_BUTTON_{name.upper()}"))
        }
        new, self._pressed = pressed - self._pressed, pressed
        return sticks_of_axes(*axes), [BUTTONS[name] for name in sorted(new)]

    def close(self) -> None:
        """Close the gamepad."""
        self._controller.quit()
        self._pygame.quit()
