"""Requests to a vehicle, read from MAVLink frames."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common as mav

from arena.authority import Kind, Request, parse_request
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
        (mav.MAVLink_set_mode_message(1, 1, 6 << 16), "OFFBOARD"),
    ],
)
def test_commands_that_set_a_mode(message, mode):
    assert parse(message) == Request(Kind.MODE, mode, getattr(message, "command", 0))


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
        mav.MAVLink_serial_control_message(10, 6, 0, 0, 14, list(b"commander arm\n".ljust(70, b"\0"))),
    ],
)
def test_everything_that_can_spin_a_motor(message):  # review fault 16
    assert parse(message).kind is Kind.SPIN


@pytest.mark.parametrize(
    "message", [long(511, 30, 20000), long(241, 1), mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)]
)
def test_frames_that_move_nothing(message):
    assert parse(message) is None
