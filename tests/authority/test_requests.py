"""Requests to a vehicle, read from MAVLink frames."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common as mav

from arena.authority import PROGRAM_MODES, Kind, Request, parse_request
from arena.wire.mavlink_frame import parse_frames

SENDER = mav.MAVLink(None, srcSystem=255, srcComponent=190)


def parse(message) -> Request | None:
    data = message.pack(SENDER)
    (frame,) = parse_frames(data).frames
    return parse_request(data, frame)


def long(command: int, *params: float) -> mav.MAVLink_command_long_message:
    return mav.MAVLink_command_long_message(1, 1, command, 0, *(*params, *(0.0,) * (7 - len(params))))


@pytest.mark.parametrize(
    ("params", "kind"),
    [
        ((1,), Kind.ARM),
        ((1, 21196), Kind.ARM),
        ((0.4,), Kind.DISARM),
        ((0, 21196), Kind.KILL),
        ((float("nan"),), Kind.DISARM),
    ],
)
def test_arming_commands(params, kind):
    assert parse(long(400, *params)).kind is kind


@pytest.mark.parametrize(
    ("message", "mode"),
    [
        (long(176, 1, 6, 0), "OFFBOARD"),
        (long(176, 1, 4, 6), "AUTO.LAND"),
        (long(176, 29, 3), "POSCTL"),
        (long(21), "AUTO.LAND"),
        (long(20), "AUTO.RTL"),
        (long(22), "AUTO.TAKEOFF"),
        (long(262, 7), "AUTO.LAND"),
        (long(262, 6.5), "AUTO.LAND"),
        (long(262, 263), "unclear mode"),
        (long(186, 12), "REPOSITION"),
        (long(84), "AUTO.VTOL_TAKEOFF"),
        (long(23), "AUTO.PRECLAND"),
        (mav.MAVLink_set_mode_message(1, 1, 6 << 16), "OFFBOARD"),
    ],
)
def test_commands_that_set_a_mode(message, mode):
    assert parse(message) == Request(Kind.MODE, mode, getattr(message, "command", 0))


BASE_MODES = [(4, "AUTO.MISSION"), (68, "AUTO.MISSION"), (64, "MANUAL"), (72, "POSCTL"), (80, "STABILIZED")]


@pytest.mark.parametrize(("base", "mode"), [*BASE_MODES, (0, "base mode 0"), (128, "base mode 128")])
def test_without_the_flag_custom_mode_px4_uses_the_base_mode(base, mode):
    """PX4 then ignores the numbers of AUTO.LAND, which also follow."""
    assert parse(long(176, base, 4, 6)).mode == mode
    assert parse(mav.MAVLink_set_mode_message(1, base, 4 << 16 | 6 << 24)).mode == mode


@pytest.mark.parametrize(
    ("numbers", "mode"),
    [
        ((1, 4, 0), "AUTO.MISSION"),
        ((1, 6.9, 0), "OFFBOARD"),
        ((1, 4, 5.6), "AUTO.RTL"),
        ((1, 3.6, 6), "POSCTL"),
        ((1.9, 4.9, 6.9), "AUTO.LAND"),
        ((0.9, 4, 6), "base mode 0"),
        ((1, 262, 0), "unclear mode"),
        ((1, 4, -250), "unclear mode"),
        ((257, 4, 6), "unclear mode"),
        ((1, float("inf"), 0), "unclear mode"),
    ],
)
def test_numbers_of_a_mode_are_cut_to_bytes_as_in_px4(numbers, mode):
    assert parse(long(176, *numbers)).mode == mode
    if mode in ("unclear mode", "OFFBOARD", "AUTO.MISSION"):
        assert mode in PROGRAM_MODES


@pytest.mark.parametrize("command", [300, 189])
def test_commands_that_start_a_mission_arm(command):
    """PX4's navigator replies to DO_LAND_START with a MISSION_START of its own, which arms."""
    assert parse(long(command)).kind is Kind.ARM


def test_command_int_is_read_like_command_long():
    m = mav.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, 1, 6, 0, 0, 0, 0, 0)
    assert parse(m) == Request(Kind.MODE, "OFFBOARD", 176)


@pytest.mark.parametrize(
    "params", [(0, 0, 0), (1, 6, 0), (1, 4, 6), (0, 21196, 0), (float("nan"), 1, 0), (7, 0, 0), (-1, 1, 0)]
)
def test_command_int_and_command_long_are_judged_alike(params):
    """Commands with a place come as COMMAND_INT from ROS 2 and ground stations."""
    judged = set()
    for number in (*range(0, 700), 2500, 31000, 42600, 43003):
        for z in (0.0, 1.0, 491.5):
            in_int = mav.MAVLink_command_int_message(
                1, 1, 0, number, 0, 0, *params, 0, 473_977_421, 85_455_943, z
            )
            found = parse(in_int)
            assert found == parse(long(number, *params, 0, 47.4, 8.5, z)), number
            judged.add(found)
    assert len(judged) > 8


@pytest.mark.parametrize(
    "message",
    [
        long(310, 0.5, 1, 0, 0, 1),
        long(209, 1, 1, 20),
        long(241, 0, 0, 0, 0, 0, 0, 1),
        long(187, 1),
        long(243, 0.5),
        mav.MAVLink_serial_control_message(10, 6, 0, 0, 14, list(b"commander arm\n".ljust(70, b"\0"))),
    ],
)
def test_everything_that_can_spin_a_motor(message):  # review fault 16
    assert parse(message).kind is Kind.SPIN


@pytest.mark.parametrize("kind", [1, 3, 0.5, -1.6, float("nan")])
def test_injection_of_a_failure(kind):
    assert parse(long(420, 101, kind, 1)) == Request(Kind.FAILURE, command=420)


@pytest.mark.parametrize("kind", [0, 0.4, -1.4])
def test_end_of_an_injected_failure_is_no_request(kind):
    """FAILURE_TYPE_OK, as PX4 rounds it, must end a failure in every state."""
    assert parse(long(420, 101, kind, 1)) is None


@pytest.mark.parametrize(
    "message", [long(511, 30, 20000), long(241, 1), mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)]
)
def test_frames_that_move_nothing(message):
    assert parse(message) is None
