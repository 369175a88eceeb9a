"""The source of stick positions that counts, moved sticks and gestures."""

from __future__ import annotations

import pytest

from arena.autopilot.manual_control import ManualControl
from arena.wire.sticks import Sticks

LOSS_S, GESTURE_S = 0.5, 1.0
ARM = Sticks(throttle=-1.0, yaw=1.0)
DISARM = Sticks(throttle=-1.0, yaw=-1.0)


def pilot(sticks: Sticks, source="joystick", in_mode=1, until=1.0):
    """Return manual control that has received `sticks` 50 times a second until `until` [s]."""
    control, gestures = ManualControl(), []
    for k in range(round(until * 50)):
        control.receive(source, k / 50, sticks)
        gestures.append(control.update(k / 50, in_mode, LOSS_S, GESTURE_S).gesture)
    return control, gestures


def test_lost_sticks_are_reported_after_com_rc_loss_t():
    control, _ = pilot(Sticks(roll=0.3))
    assert control.update(1.4, 1, LOSS_S, GESTURE_S).sticks == Sticks(roll=0.3)
    assert control.update(1.5, 1, LOSS_S, GESTURE_S).sticks is None


def test_second_source_counts_only_after_the_first_is_lost():
    control, _ = pilot(Sticks(roll=0.3), in_mode=2)
    control.receive("radio", 1.0, Sticks(roll=-0.9))
    assert control.update(1.0, 2, LOSS_S, GESTURE_S).sticks == Sticks(roll=0.3)
    control.receive("radio", 1.6, Sticks(roll=-0.9))
    assert control.update(1.6, 2, LOSS_S, GESTURE_S).sticks == Sticks(roll=-0.9)


def test_stick_that_moves_has_a_speed_and_a_deflected_one_has_none():
    control, _ = pilot(Sticks(roll=0.8))
    assert control.update(1.0, 1, LOSS_S, GESTURE_S).speed == pytest.approx(0.0, abs=1e-6)
    control.receive("joystick", 1.02, Sticks(roll=-0.2))
    assert control.update(1.02, 1, LOSS_S, GESTURE_S).speed > 1.0


def test_first_position_of_the_sticks_is_no_motion():
    control = ManualControl()
    control.receive("joystick", 0.0, Sticks(roll=1.0, throttle=-1.0))
    assert control.update(0.0, 1, LOSS_S, GESTURE_S).speed == 0.0


@pytest.mark.parametrize(("sticks", "gesture"), [(ARM, "arm"), (DISARM, "disarm")])
def test_gesture_completes_once_after_its_time(sticks, gesture):
    _, found = pilot(sticks, until=3.0)
    assert found.count(gesture) == 1 and found.index(gesture) == 50


def test_gesture_needs_a_centred_right_stick():
    _, found = pilot(Sticks(throttle=-1.0, yaw=1.0, roll=0.2), until=3.0)
    assert not any(found)
