"""Queue of frames for the flight controller, which drops frames that are too old. Pure.

The queue is short, because the autopilot would treat a pose or setpoint that has waited as a current one. Of each kind
of pose, setpoint, manual input and sensor message only the newest frame waits.

Frames of `land-all` and `kill-all` (lane PANIC) are sent first. The other lanes share the connection by their weights: on a
connection that is too slow for all frames, each lane still sends its share, so a flood in one lane does not delay the
poses, setpoints and commands in the other lanes for long. While the shares differ little, frames are sent by their source
(`Priority`) and in the order of their arrival.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.age_limits import MANUAL_INPUTS, POSES, SETPOINTS, age_limit_s

MAX_BYTES = 8192


class Priority(IntEnum):
    """Priority of a frame for the flight controller.

    It depends on the source of the frame.

    A smaller value is sent first, if several lanes (parts of the send queue) have sent equal shares.

    PANIC: land-all and kill-all
    ROUTER: the MAVLink router
    SIMULATOR: the world (the simulator process)
    VISION: the pose forwarder
    """

    PANIC = 0
    ROUTER = 1
    SIMULATOR = 2
    VISION = 3


class Lane(IntEnum):
    """Part of the queue of frames for the flight controller, with its own share of the connection.

    PANIC (land-all and kill-all) is always sent first; the other lanes share the connection.

    PANIC, SIMULATOR and VISION contain the frames of one source each. COMMAND, SETPOINT and OTHER contain the frames of
    the router.
    """

    PANIC = 0
    COMMAND = 1
    SETPOINT = 2
    OTHER = 3
    SIMULATOR = 4
    VISION = 5


# Shares of the bytes on a slow connection. Poses have the largest share: without them the vehicle must land.
_WEIGHTS = {Lane.COMMAND: 2, Lane.VISION: 6, Lane.SETPOINT: 2, Lane.SIMULATOR: 6, Lane.OTHER: 1}
_EQUAL_SHARES = 100.0  # lanes whose shares differ by less are equal [bytes / weight]
_COMMANDS = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SET_MODE,
        mavlink.MAVLINK_MSG_ID_COMMAND_INT,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    }
)
_STEERING = SETPOINTS | MANUAL_INPUTS
# Of these messages only the newest waits. PX4 stamps each frame on arrival, so two poses that arrive together would have the
# same time.
_NEWEST_ONLY = POSES | _STEERING | {mavlink.MAVLINK_MSG_ID_HIL_SENSOR, mavlink.MAVLINK_MSG_ID_HIL_GPS}


class QueuedFrame(NamedTuple):
    """Frame in the send queue, with its message id and priority.

    since: time at which this computer received the frame [s]. place: number in the order of arrival.
    """

    frame: bytes
    msgid: int
    since: float
    priority: Priority
    place: int


@dataclass(kw_only=True)
class _Frames:
    """Frames that wait in one lane (part of the send queue), and the bytes that the lane has sent.

    sent: bytes that the lane has sent, divided by its weight. A lane that was empty starts with the value of the lane that
    sent last.
    """

    frames: deque[QueuedFrame] = field(default_factory=deque)
    sent: float = 0.0


class SendQueue:
    """Queue of frames for the flight controller, divided into lanes that share the connection.

    counts: number of frames that were not sent, by reason
    pose_age_s: age limit of poses [s]; 0 for the usual limit
    """

    def __init__(self, counts: Counter[str], pose_age_s: float = 0.0) -> None:
        self._counts, self._pose_age_s = counts, pose_age_s
        self._lanes = {lane: _Frames() for lane in Lane}
        self._sent = 0.0
        self._bytes = self._place = 0

    def __len__(self) -> int:
        return sum(len(lane.frames) for lane in self._lanes.values())

    def put(self, priority: Priority, frame: bytes, msgid: int, since: float) -> None:
        """Add a frame to the queue. If the queue is full, drop the oldest frame of the largest lane.

        A frame of PANIC is dropped only if the other lanes are empty.
        A frame that replaces an older one takes its place, so that it is not sent later because of the
        replacement.
        since: time at which this computer received the frame [s]
        """
        lane = self._lanes[_lane_of(priority, msgid)]
        if not lane.frames:
            lane.sent = max(lane.sent, self._sent)
        waiting = self._waiting(lane, msgid)
        if waiting is None:
            self._place += 1
            lane.frames.append(QueuedFrame(frame, msgid, since, priority, self._place))
        else:
            old = lane.frames[waiting]
            self._drop(old, "replaced by a newer one")
            lane.frames[waiting] = QueuedFrame(frame, msgid, since, priority, old.place)
        self._bytes += len(frame)
        while self._bytes > MAX_BYTES:
            self._drop(self._largest_lane().frames.popleft(), "queue full")

    def take(self, now: float) -> QueuedFrame | None:
        """Remove and return the next frame to send; None if the queue is empty.

        Frames that are too old are dropped.
        """
        while (lane := self._next_lane()) is not None:
            found = self._lanes[lane].frames.popleft()
            if now - found.since > self._limit_s(found.msgid):
                self._drop(found, "waited too long")
                continue
            self._bytes -= len(found.frame)
            if lane is not Lane.PANIC:
                self._sent = max(self._sent, self._lanes[lane].sent)
                self._lanes[lane].sent += len(found.frame) / _WEIGHTS[lane]
            return found
        return None

    def clear(self) -> None:
        """Drop all frames after an interruption of the connection.

        Old frames must not be sent when the connection works again.
        """
        for lane in self._lanes.values():
            for queued in lane.frames:
                self._counts[f"to the vehicle: not connected ({queued.priority.name.lower()})"] += 1
            lane.frames.clear()
        self._bytes = 0

    def _next_lane(self) -> Lane | None:
        """Return the lane (part of the queue) that sends next; None if the queue is empty.

        PANIC is first if it has frames. Otherwise it is the lane that has sent least for its weight.
        """
        if self._lanes[Lane.PANIC].frames:
            return Lane.PANIC
        waiting = {name: lane for name, lane in self._lanes.items() if lane.frames}
        if not waiting:
            return None
        least = min(lane.sent for lane in waiting.values())
        equal = [name for name, lane in waiting.items() if lane.sent < least + _EQUAL_SHARES]
        return min(equal, key=lambda name: (waiting[name].frames[0].priority, waiting[name].frames[0].place))

    def _largest_lane(self) -> _Frames:
        others = [lane for name, lane in self._lanes.items() if lane.frames and name is not Lane.PANIC]
        return max(
            others or [self._lanes[Lane.PANIC]], key=lambda lane: sum(len(q.frame) for q in lane.frames)
        )

    def _waiting(self, lane: _Frames, msgid: int) -> int | None:
        """Return the index of the waiting frame that a new frame replaces; None if there is none.

        msgid: message id of the new frame

        Only the newest pose, setpoint, manual input and sensor message waits, because older ones are out of date.
        """
        if msgid not in _NEWEST_ONLY:
            return None
        return next((i for i, queued in enumerate(lane.frames) if queued.msgid == msgid), None)

    def _limit_s(self, msgid: int) -> float:
        return self._pose_age_s if self._pose_age_s and msgid in POSES else age_limit_s(msgid)

    def _drop(self, dropped: QueuedFrame, why: str) -> None:
        self._bytes -= len(dropped.frame)
        self._counts[f"to the vehicle: {why} ({dropped.priority.name.lower()})"] += 1


def _lane_of(priority: Priority, msgid: int) -> Lane:
    if priority is not Priority.ROUTER:
        return Lane[priority.name]
    if msgid in _STEERING:
        return Lane.SETPOINT
    return Lane.COMMAND if msgid in _COMMANDS else Lane.OTHER
