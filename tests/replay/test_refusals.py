"""Tests of the replies to commands that reach a replayed vehicle."""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.replay.refusals import Refusals
from arena.replay.state_messages import StateMessages
from arena.wire.mavlink_codec import Codec
from tests.replay.scripts import heartbeat

PROGRAM = Codec(1, 191)


def command(number: int, param1: float = 0.0) -> bytes:
    return PROGRAM.pack(mavlink.MAVLink_command_long_message(1, 1, number, 0, param1, 0, 0, 0, 0, 0, 0))


def replies(data: bytes, refusals: Refusals | None = None) -> list[mavlink.MAVLink_message]:
    refusals = refusals or Refusals(["uav1"], [1])
    state = StateMessages(1)
    state.take(0, heartbeat())
    found = refusals.on_datagram(0, data, state, 10.0)
    return [message for reply in found for message in Codec(9, 9).parse(reply)]


def test_arming_is_denied_and_reported_once() -> None:
    refusals = Refusals(["uav1"], [1])
    arm = command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    text, ack = replies(arm, refusals)
    assert text.get_type() == "STATUSTEXT" and "replay" in text.text
    assert (ack.command, ack.result) == (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_RESULT_DENIED)
    assert (ack.target_system, ack.target_component) == (1, 191)
    replies(arm, refusals)
    (event,) = refusals.take_events()
    assert event.startswith("uav1: refused: arm from system 1")
    assert refusals.counts["arm"] == 2


def test_every_other_command_is_denied() -> None:
    for number in (21, 22, 176, 185, 300, 31010):
        assert replies(command(number))[-1].result == mavlink.MAV_RESULT_DENIED


def test_setpoint_is_ignored_and_reported() -> None:
    refusals = Refusals(["uav1"], [1])
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, *([0.0] * 11))
    assert replies(PROGRAM.pack(setpoint), refusals) == []
    assert "ignored: setpoint" in refusals.take_events()[0]


def test_message_rate_is_accepted_without_a_report() -> None:
    refusals = Refusals(["uav1"], [1])
    (ack,) = replies(command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32.0), refusals)
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert refusals.take_events() == []


def test_requested_state_message_is_sent_again() -> None:
    ack, message = replies(command(mavlink.MAV_CMD_REQUEST_MESSAGE, 0.0))
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert message.get_type() == "HEARTBEAT"


def test_request_for_a_message_that_was_not_recorded_is_unsupported() -> None:
    (ack,) = replies(command(mavlink.MAV_CMD_REQUEST_MESSAGE, 242.0))
    assert ack.result == mavlink.MAV_RESULT_UNSUPPORTED


def test_heartbeats_of_clients_get_no_reply() -> None:
    refusals = Refusals(["uav1"], [1])
    assert replies(PROGRAM.onboard_heartbeat(), refusals) == []
    assert not refusals.counts
