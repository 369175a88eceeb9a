"""Tests of the state messages that are repeated when a replay begins in the middle."""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.replay.state_messages import StateMessages
from arena.wire.mavlink_codec import Codec
from tests.replay.scripts import heartbeat, position


def test_newest_frame_of_each_message_is_kept() -> None:
    state = StateMessages(1)
    state.take(0, heartbeat(mode=1) + position(1, 0.0))
    state.take(0, heartbeat(mode=2))
    assert state.all() == [(0, heartbeat(mode=2)), (0, position(1, 0.0))]


def test_messages_without_a_lasting_meaning_are_not_kept() -> None:
    state = StateMessages(1)
    state.take(0, Codec(1, 1).pack(mavlink.MAVLink_statustext_message(6, b"armed")))
    assert state.all() == []


def test_heartbeat_of_each_vehicle_is_first() -> None:
    state = StateMessages(2)
    landed = Codec(2, 1).pack(mavlink.MAVLink_extended_sys_state_message(0, 1))
    state.take(1, landed)
    state.take(1, heartbeat(2))
    state.take(0, heartbeat(1))
    assert state.all() == [(0, heartbeat(1)), (1, heartbeat(2)), (1, landed)]


def test_frames_of_other_components_are_ignored() -> None:
    state = StateMessages(1)
    state.take(0, Codec(1, 191).onboard_heartbeat())
    assert state.all() == []
