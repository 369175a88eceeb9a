"""Stick positions from a gamepad, with a fake of pygame's controller."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import pytest

from arena.errors import InputError
from arena.fly.gamepad import Gamepad, sticks_of_axes
from arena.wire.sticks import CENTRED, Sticks

AXES = ("LEFTX", "LEFTY", "RIGHTX", "RIGHTY")


def test_left_stick_is_throttle_and_yaw_right_stick_is_pitch_and_roll():
    assert sticks_of_axes(0, 0, 0, 0) == CENTRED
    assert sticks_of_axes(32767, 0, 0, 0) == Sticks(yaw=1.0)
    assert sticks_of_axes(0, -32768, 0, 0) == Sticks(throttle=1.0)
    assert sticks_of_axes(0, 0, 32767, 0) == Sticks(roll=1.0)
    assert sticks_of_axes(0, 0, 0, -32768) == Sticks(pitch=1.0)


class Pad:
    def __init__(self, number: int) -> None:
        self.axes = dict.fromkeys(AXES, 0)
        self.buttons: set[str] = set()
        self.present = True

    def attached(self) -> bool:
        return self.present

    def get_axis(self, name: str) -> int:
        return self.axes[name]

    def get_button(self, name: str) -> bool:
        return name in self.buttons

    def quit(self) -> None:
        pass


@pytest.fixture
def pygame(monkeypatch):
    """Replace pygame by a fake with one gamepad. Returns the settings of the fake."""
    fake, sdl, controller = ModuleType("pygame"), ModuleType("pygame._sdl2"), ModuleType("controller")
    settings = SimpleNamespace(count=1)
    fake.display = fake.event = SimpleNamespace(init=lambda: None, pump=lambda: None)
    fake.quit = lambda: None
    for name in AXES:
        setattr(fake, f"CONTROLLER_AXIS_{name}", name)
    for name in ("A", "B", "X", "Y", "START", "BACK"):
        setattr(fake, f"CONTROLLER_BUTTON_{name}", name)
    controller.init, controller.get_count = lambda: None, lambda: settings.count
    controller.is_controller, controller.Controller = lambda k: True, Pad
    sdl.controller, fake._sdl2 = controller, sdl
    for name, module in (("pygame", fake), ("pygame._sdl2", sdl), ("pygame._sdl2.controller", controller)):
        monkeypatch.setitem(sys.modules, name, module)
    return settings


def test_held_button_requests_its_action_once(pygame):
    gamepad = Gamepad()
    gamepad._controller.buttons = {"A", "START"}
    assert gamepad.poll() == (CENTRED, ["POSCTL", "arm"])
    assert gamepad.poll() == (CENTRED, [])


def test_disconnected_gamepad_has_no_stick_positions(pygame):
    gamepad = Gamepad()
    gamepad._controller.axes["RIGHTX"] = 32767
    assert gamepad.poll()[0] == Sticks(roll=1.0)
    gamepad._controller.present = False
    assert gamepad.poll() == (None, [])


def test_missing_gamepad_is_an_input_error(pygame):
    pygame.count = 0
    with pytest.raises(InputError, match="no gamepad"):
        Gamepad()
