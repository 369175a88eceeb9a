"""The queue of frames for the flight controller: newest only, age limits and shares of a slow connection."""

from __future__ import annotations

from collections import Counter

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.send_queue import Lane, Priority, SendQueue

SETPOINT = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
ATTITUDE_SETPOINT = mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET
ODOMETRY = mavlink.MAVLINK_MSG_ID_ODOMETRY
COMMAND = mavlink.MAVLINK_MSG_ID_COMMAND_LONG
PARAM_READ = mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ


def test_only_the_newest_of_waiting_setpoints_is_sent():  # review fault 13
    queue = SendQueue(Counter())
    for i in range(45):
        queue.put(Priority.ROUTER, bytes([i]) * 65, SETPOINT, i * 0.02)
        queue.put(Priority.ROUTER, bytes([i]) * 51, ATTITUDE_SETPOINT, i * 0.02)
    sent = [queue.take(0.9), queue.take(0.9)]
    assert [(f.msgid, f.frame[0]) for f in sent if f] == [(SETPOINT, 44), (ATTITUDE_SETPOINT, 44)]
    assert queue.take(0.9) is None


@pytest.mark.parametrize(
    ("source", "msgid", "limit_s"),
    [
        (Priority.ROUTER, SETPOINT, 0.2),
        (Priority.ROUTER, mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, 0.2),
        (Priority.ROUTER, COMMAND, 1.0),
        (Priority.PANIC, COMMAND, 1.0),
        (Priority.VISION, ODOMETRY, 0.15),
    ],
)
def test_a_frame_is_dropped_above_the_age_limit_of_its_class(source, msgid, limit_s):  # review fault 13
    counts: Counter[str] = Counter()
    queue = SendQueue(counts, pose_age_s=0.15)
    queue.put(source, b"old", msgid, 10.0)
    assert queue.take(10.0 + limit_s + 0.001) is None
    assert counts == {f"to the vehicle: waited too long ({source.name.lower()})": 1}
    queue.put(source, b"young", msgid, 10.0)
    assert queue.take(10.0 + limit_s - 0.001)


def sent_at_230400_baud(queue: SendQueue, seconds: float) -> Counter[int]:
    """Send for some seconds what the line carries, under a flood from the router; return frames per message."""
    sent: Counter[int] = Counter()
    for step in range(round(seconds * 50)):
        now = step * 0.02
        for _ in range(4):
            queue.put(Priority.ROUTER, b"x" * 51, ATTITUDE_SETPOINT, now)
        for _ in range(30):
            queue.put(Priority.ROUTER, b"x" * 37, PARAM_READ, now)
        queue.put(Priority.ROUTER, b"x" * 45, COMMAND, now)
        queue.put(Priority.VISION, b"o" * 245, ODOMETRY, now)
        room = 230_400 / 10 * 0.02
        while room > 0 and (frame := queue.take(now)):
            room -= len(frame.frame)
            sent[frame.msgid] += 1
    return sent


def test_poses_setpoints_and_commands_pass_a_flood_on_a_slow_line():  # review fault 13
    sent = sent_at_230400_baud(SendQueue(Counter()), 5.0)
    assert sent[ODOMETRY] >= 225  # of 250
    assert sent[ATTITUDE_SETPOINT] >= 225
    assert sent[COMMAND] >= 225
    assert sent[PARAM_READ] > 0


def test_panic_is_sent_before_everything_else():
    queue = SendQueue(Counter())
    for source, msgid in ((Priority.VISION, ODOMETRY), (Priority.ROUTER, COMMAND), (Priority.PANIC, COMMAND)):
        for _ in range(3):
            queue.put(source, b"x" * 45, msgid, 0.0)
    assert [f.priority for f in (queue.take(0.0) for _ in range(3)) if f] == [Priority.PANIC] * 3


def test_commands_of_the_router_keep_their_order():
    queue = SendQueue(Counter())
    for i, msgid in enumerate((COMMAND, SETPOINT, PARAM_READ, COMMAND)):
        queue.put(Priority.ROUTER, bytes([i]), msgid, 0.0)
    assert [f.frame[0] for f in (queue.take(0.0) for _ in range(4)) if f] == [0, 1, 2, 3]


def test_a_full_queue_drops_the_flood_and_keeps_the_pose():
    counts: Counter[str] = Counter()
    queue = SendQueue(counts)
    queue.put(Priority.VISION, b"o" * 245, ODOMETRY, 0.0)
    for _ in range(400):
        queue.put(Priority.ROUTER, b"x" * 37, PARAM_READ, 0.0)
    sent = []
    while (frame := queue.take(0.0)) is not None:
        sent.append(frame.msgid)
    assert ODOMETRY in sent
    assert set(counts) == {"to the vehicle: queue full (router)"}


def test_each_lane_except_panic_has_a_share():
    queue = SendQueue(Counter())
    for source in Priority:
        queue.put(source, b"x", PARAM_READ, 0.0)
    assert len([queue.take(0.0) for _ in Priority]) == 4
    assert queue.take(0.0) is None
    assert min(set(Lane) - {Lane.PANIC}) > Lane.PANIC
