"""The messages that land-all packs and parses, compared with pymavlink."""

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.wire import mavlink_minimal as mav
from arena.wire.mavlink_frame import parse_frames

byte, word = st.integers(0, 255), st.integers(0, 0xFFFF)
real = st.floats(width=32, allow_nan=False)


def oracle(component=200):
    return mavlink.MAVLink(None, srcSystem=253, srcComponent=component)


def test_the_onboard_heartbeat_has_pymavlinks_bytes():
    ours, theirs = mav.MinimalSender(253, 200), oracle()
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
def test_a_command_has_pymavlinks_bytes(system, component, number, params):
    filled = [*params, *[0.0] * (7 - len(params))]
    wanted = mavlink.MAVLink_command_long_message(system, component, number, 0, *filled).pack(oracle())
    assert mav.MinimalSender(253, 200).command(system, component, number, *params) == bytes(wanted)


def received(message):
    data = bytes(message.pack(mavlink.MAVLink(None, srcSystem=7, srcComponent=1)))
    (at,) = parse_frames(data).frames
    return data, at


@given(st.integers(0, 2**32 - 1), byte)
def test_a_heartbeat_of_pymavlink_is_parsed(custom, base):
    assert mav.parse_heartbeat(*received(mavlink.MAVLink_heartbeat_message(2, 12, base, custom, 4, 3))) == (
        custom,
        base,
    )


@given(byte, byte)
def test_a_landed_state_of_pymavlink_is_parsed(vtol, landed):
    assert (
        mav.parse_landed_state(*received(mavlink.MAVLink_extended_sys_state_message(vtol, landed))) == landed
    )


@given(word, byte, byte, st.integers(-(2**31), 2**31 - 1), byte, byte)
def test_an_acknowledgement_of_pymavlink_is_parsed(command, result, progress, more, system, component):
    ack = mavlink.MAVLink_command_ack_message(command, result, progress, more, system, component)
    assert mav.parse_ack(*received(ack)) == (command, result, (system, component))


def test_the_constants_are_those_of_the_dialect():
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
        "IN_PROGRESS": "MAV_RESULT_IN_PROGRESS",
        "HEARTBEAT": "MAVLINK_MSG_ID_HEARTBEAT",
        "COMMAND_LONG": "MAVLINK_MSG_ID_COMMAND_LONG",
        "COMMAND_ACK": "MAVLINK_MSG_ID_COMMAND_ACK",
        "EXTENDED_SYS_STATE": "MAVLINK_MSG_ID_EXTENDED_SYS_STATE",
    }.items():
        assert getattr(mav, ours) == getattr(mavlink, theirs), ours


def test_each_mav_result_of_the_dialect_has_words():
    known = {number for number, entry in mavlink.enums["MAV_RESULT"].items() if "ENUM_END" not in entry.name}
    assert known <= set(mav.RESULT_WORDS)
    assert mav.result_words(1) == "temporarily rejected" and mav.result_words(99) == "result 99"


@given(
    st.integers(0, 7), st.text(alphabet=st.characters(codec="ascii", exclude_characters="\0"), max_size=50)
)
def test_a_text_of_pymavlink_is_parsed(severity, text):
    message = mavlink.MAVLink_statustext_message(severity, text.encode(), 0, 0)
    assert mav.parse_statustext(*received(message)) == (severity, text.rstrip("\t"))


@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_the_firmware_version_of_pymavlink_is_parsed(major, minor, patch, kind):
    number, none = major << 24 | minor << 16 | patch << 8 | kind, [0] * 8
    message = mavlink.MAVLink_autopilot_version_message(0, number, 0, 0, 0, none, none, none, 0, 0, 0)
    assert mav.parse_firmware_version(*received(message)) == (major, minor, patch)


@given(st.integers(0, 2**64 - 1), st.binary(min_size=18, max_size=18))
def test_the_hardware_uid_of_pymavlink_is_parsed(uid, uid2):
    eight = [7] * 8
    message = mavlink.MAVLink_autopilot_version_message(1, 2, 3, 4, 5, eight, eight, eight, 6, 7, uid, uid2)
    found = mav.parse_hardware_uid(*received(message))
    assert found == (uid, uid2)
    assert mav.parse_firmware_version(*received(message)) == (0, 0, 0)
    assert found.matches(f"{uid:016X}") is (uid != 0) and found.matches(uid2.hex()) is any(uid2)
    assert not found.matches("") and not found.matches("11" * 8 if uid != 0x1111111111111111 else "22" * 8)
    assert str(found) == (uid2.hex() if any(uid2) else f"{uid:016x}" if uid else "")


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**32 - 1))
def test_the_time_since_boot_of_pymavlink_is_parsed(unix_us, boot_ms):
    assert mav.parse_boot_ms(*received(mavlink.MAVLink_system_time_message(unix_us, boot_ms))) == boot_ms


def test_the_request_for_the_hardware_uid_is_that_of_pymavlink():
    wanted = mavlink.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0
    )
    ours = mav.MinimalSender(253, 200).command(1, 1, mav.REQUEST_MESSAGE, mav.AUTOPILOT_VERSION)
    assert ours == bytes(wanted.pack(mavlink.MAVLink(None, srcSystem=253, srcComponent=200)))
