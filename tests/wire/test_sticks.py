"""Stick positions in MANUAL_CONTROL and RC messages."""

from __future__ import annotations

import pytest

from arena.wire.sticks import (
    CENTRED,
    Sticks,
    manual_control_fields,
    sticks_from_channels,
    sticks_from_manual_control,
)


def test_manual_control_maps_pitch_roll_throttle_and_yaw():
    found = sticks_from_manual_control(250, -500, 1000, 1000)
    assert found == Sticks(pitch=0.25, roll=-0.5, throttle=1.0, yaw=1.0)
    assert sticks_from_manual_control(0, 0, 500, 0) == CENTRED


@pytest.mark.parametrize("xyzr", [(1001, 0, 500, 0), (0, -1001, 500, 0), (0, 0, -1, 0), (0, 0, 500, 32767)])
def test_stick_out_of_range_counts_as_centred(xyzr):
    assert sticks_from_manual_control(*xyzr) == CENTRED


def test_radio_channels_are_roll_pitch_throttle_and_yaw():
    found = sticks_from_channels(1750, 1250, 1000, 2500)
    assert found == Sticks(roll=0.5, pitch=-0.5, throttle=-1.0, yaw=1.0)
    assert sticks_from_channels(0, 65535, 1500, 1500) == CENTRED


@pytest.mark.parametrize("sticks", [CENTRED, Sticks(roll=0.25, pitch=-1.0, throttle=0.5, yaw=-0.125)])
def test_stick_positions_survive_a_round_trip(sticks):
    assert sticks_from_manual_control(*manual_control_fields(sticks)) == sticks
