"""Stick positions from the keys of a terminal."""

from __future__ import annotations

import pytest

from arena.fly.keyboard import ACTIONS, FIRST_HOLD_S, REPEAT_HOLD_S, Keyboard, parse_keys
from arena.wire.sticks import CENTRED, Sticks


def test_arrows_and_characters_are_parsed():
    assert parse_keys(b"w\x1b[A\x1bOD Q\x03") == ["w", "up", "left", " ", "q", "\x03"]
    assert parse_keys(b"\x1b[Fs") == ["s"]
    assert parse_keys(b"\x1b") == []


@pytest.mark.parametrize(
    ("key", "sticks"),
    [
        ("up", Sticks(pitch=0.5)),
        ("down", Sticks(pitch=-0.5)),
        ("right", Sticks(roll=0.5)),
        ("left", Sticks(roll=-0.5)),
        ("d", Sticks(yaw=0.5)),
        ("a", Sticks(yaw=-0.5)),
        ("s", Sticks(throttle=-1.0)),
    ],
)
def test_key_deflects_its_stick(key, sticks):
    keyboard = Keyboard()
    keyboard.press(key, 10.0)
    assert keyboard.sticks(10.0) == sticks


def test_released_key_centres_the_stick():
    keyboard = Keyboard()
    keyboard.press("up", 10.0)
    assert keyboard.sticks(10.0 + FIRST_HOLD_S - 0.01).pitch == 0.5
    assert keyboard.sticks(10.0 + FIRST_HOLD_S) == CENTRED


def test_repeated_key_is_released_sooner_after_its_last_repetition():
    keyboard = Keyboard()
    for k in range(20):
        keyboard.press("right", 10.0 + 0.03 * k)
    last = 10.0 + 0.03 * 19
    assert keyboard.sticks(last + REPEAT_HOLD_S - 0.01).roll == 0.5
    assert keyboard.sticks(last + REPEAT_HOLD_S + 0.01) == CENTRED


def test_space_centres_all_sticks_at_once():
    keyboard = Keyboard()
    keyboard.press("up", 10.0)
    keyboard.press("s", 10.0)
    keyboard.press(" ", 10.1)
    assert keyboard.sticks(10.1) == CENTRED


def test_deflection_stays_within_its_limits():
    keyboard = Keyboard()
    for _ in range(20):
        keyboard.press("+", 0.0)
    assert keyboard.deflection == pytest.approx(1.0)
    for _ in range(20):
        keyboard.press("-", 0.0)
    assert keyboard.deflection == pytest.approx(0.2)


def test_keys_of_sticks_request_no_action():
    keyboard = Keyboard()
    assert not any(
        keyboard.press(key, 0.0) for key in ("w", "a", "s", "d", "up", "down", "left", "right", " ", "+", "z")
    )
    assert [keyboard.press(key, 0.0) for key in ACTIONS] == list(ACTIONS.values())
