"""The panic path's messages, against pymavlink."""

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.wire import mavlink_minimal as say
from arena.wire.mavlink_frame import cut

byte, word = st.integers(0, 255), st.integers(0, 0xFFFF)
real = st.floats(width=32, allow_nan=False)


def oracle(component=200):
    return mavlink.MAVLink(None, srcSystem=253, srcComponent=component)


def test_the_heartbeat_is_pymavlinks_and_numbers_go_up():
    ours, theirs = say.Voice(253, 200), oracle()
    for _ in range(300):
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
            mavlink.MAV_AUTOPILOT_INVALID,
            0,
            0,
            mavlink.MAV_STATE_ACTIVE,
            3,
        )
        assert ours.heartbeat() == bytes(beat.pack(theirs))
        theirs.seq = (theirs.seq + 1) % 256


@given(byte, byte, word, st.lists(real, max_size=7))
def test_commands_are_pymavlinks(system, component, number, params):
    filled = [*params, *[0.0] * (7 - len(params))]
    wanted = mavlink.MAVLink_command_long_message(system, component, number, 0, *filled).pack(oracle())
    assert say.Voice(253, 200).command(system, component, number, *params) == bytes(wanted)


def heard(message):
    data = bytes(message.pack(mavlink.MAVLink(None, srcSystem=7, srcComponent=1)))
    (at,) = cut(data).frames
    return data, at


@given(st.integers(0, 2**32 - 1), byte)
def test_a_heartbeat_is_read_as_pymavlink_wrote_it(custom, base):
    assert say.heartbeat_of(*heard(mavlink.MAVLink_heartbeat_message(2, 12, base, custom, 4, 3))) == (
        custom,
        base,
    )


@given(byte, byte)
def test_the_landed_state_too(vtol, landed):
    assert say.landed_of(*heard(mavlink.MAVLink_extended_sys_state_message(vtol, landed))) == landed


@given(word, byte, byte, st.integers(-(2**31), 2**31 - 1), byte, byte)
def test_and_an_answer(command, result, progress, more, system, component):
    ack = mavlink.MAVLink_command_ack_message(command, result, progress, more, system, component)
    assert say.ack_of(*heard(ack)) == (command, result, (system, component))


def test_the_numbers_are_the_dialects():
    for ours, theirs in {
        "NAV_LAND": "MAV_CMD_NAV_LAND",
        "DO_SET_MODE": "MAV_CMD_DO_SET_MODE",
        "ARM_DISARM": "MAV_CMD_COMPONENT_ARM_DISARM",
        "SET_MESSAGE_INTERVAL": "MAV_CMD_SET_MESSAGE_INTERVAL",
        "TYPE_ONBOARD": "MAV_TYPE_ONBOARD_CONTROLLER",
        "AUTOPILOT_INVALID": "MAV_AUTOPILOT_INVALID",
        "STATE_ACTIVE": "MAV_STATE_ACTIVE",
        "ARMED": "MAV_MODE_FLAG_SAFETY_ARMED",
        "CUSTOM_MODE": "MAV_MODE_FLAG_CUSTOM_MODE_ENABLED",
        "LANDED_UNKNOWN": "MAV_LANDED_STATE_UNDEFINED",
        "LANDED_ON_GROUND": "MAV_LANDED_STATE_ON_GROUND",
        "ACCEPTED": "MAV_RESULT_ACCEPTED",
        "DENIED": "MAV_RESULT_DENIED",
        "TEMPORARILY_REJECTED": "MAV_RESULT_TEMPORARILY_REJECTED",
        "UNSUPPORTED": "MAV_RESULT_UNSUPPORTED",
        "FAILED": "MAV_RESULT_FAILED",
        "HEARTBEAT": "MAVLINK_MSG_ID_HEARTBEAT",
        "COMMAND_LONG": "MAVLINK_MSG_ID_COMMAND_LONG",
        "COMMAND_ACK": "MAVLINK_MSG_ID_COMMAND_ACK",
        "EXTENDED_SYS_STATE": "MAVLINK_MSG_ID_EXTENDED_SYS_STATE",
    }.items():
        assert getattr(say, ours) == getattr(mavlink, theirs), ours
