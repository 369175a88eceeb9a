"""Age limits of messages to a vehicle."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.authority import requests
from arena.wire import age_limits
from arena.wire.age_limits import age_limit_s, without_old_frames
from arena.wire.mavlink_codec import Codec

COMMAND = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0.0, 0, 0, 0, 0, 0, 0)
SETPOINT = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDF8, *[0.0] * 11)


def test_classes_agree_with_the_requests_that_authority_reads():
    assert age_limits.SETPOINTS == requests.SETPOINTS
    assert age_limits.MANUAL_INPUTS == requests.MANUAL_INPUTS


@pytest.mark.parametrize(("age_s", "left"), [(0.15, 2), (0.3, 1), (1.5, 0)])
def test_setpoints_become_too_old_before_commands(age_s, left):
    codec = Codec(1, 191)
    command = codec.pack(COMMAND)
    young, dropped = without_old_frames(codec.pack(SETPOINT) + command, age_s)
    assert dropped == 2 - left
    assert len(Codec(1, 1).parse(young)) == left
    assert left != 1 or young == command


def test_the_shortest_limit_is_the_least_of_all():
    assert min(age_limit_s(n) for n in range(400)) == age_limits.SHORTEST_LIMIT_S
