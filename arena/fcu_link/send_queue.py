"""Queue of frames for the flight controller, sorted by priority. Old frames are dropped. Pure.

The queue is short, because the autopilot would treat a pose or setpoint that has waited as a current one.
"""

from __future__ import annotations

from collections import Counter, deque
from enum import IntEnum
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

MAX_BYTES = 8192
MAX_AGE_S = 1.0


class Priority(IntEnum):
    """Priority of a frame, by its source; a smaller number is sent first."""

    PANIC = 0
    ROUTER = 1
    SIMULATOR = 2
    VISION = 3


# Most frames of a message that may wait; a newer one replaces the oldest. PX4 stamps each frame on arrival, so two frames that
# arrive together would have the same time.
_MAX_WAITING = {
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 1,
    mavlink.MAVLINK_MSG_ID_HIL_SENSOR: 1,
    mavlink.MAVLINK_MSG_ID_HIL_GPS: 1,
}


class QueuedFrame(NamedTuple):
    """Frame in the queue. since: time at which it was added [s]."""

    frame: bytes
    msgid: int
    since: float
    priority: Priority


class SendQueue:
    """Queue of frames, sorted by priority. counts: number of frames that were not sent, by reason."""

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self._queues: dict[Priority, deque[QueuedFrame]] = {priority: deque() for priority in Priority}
        self._bytes = 0

    def __len__(self) -> int:
        return sum(map(len, self._queues.values()))

    def put(self, priority: Priority, frame: bytes, msgid: int, now: float) -> None:
        """Add a frame. When the queue is full, the oldest frame of the lowest priority is dropped."""
        queue = self._queues[priority]
        most = _MAX_WAITING.get(msgid)
        if most is not None and sum(queued.msgid == msgid for queued in queue) >= most:
            oldest = next(queued for queued in queue if queued.msgid == msgid)
            queue.remove(oldest)
            self._drop(oldest, "replaced by a newer one")
        queue.append(QueuedFrame(frame, msgid, now, priority))
        self._bytes += len(frame)
        while self._bytes > MAX_BYTES:
            lowest = next(p for p in reversed(Priority) if self._queues[p])
            self._drop(self._queues[lowest].popleft(), "queue full")

    def take(self, now: float) -> QueuedFrame | None:
        """Remove and return the next frame to send; None if there is none. Drop frames older than
        `MAX_AGE_S`.
        """
        for queue in self._queues.values():
            while queue:
                found = queue.popleft()
                if now - found.since <= MAX_AGE_S:
                    self._bytes -= len(found.frame)
                    return found
                self._drop(found, "waited too long")
        return None

    def clear(self) -> None:
        """Drop all frames, because the connection is interrupted and old frames must not be sent after it is
        restored.
        """
        for queue in self._queues.values():
            for queued in queue:
                self._counts[f"to the vehicle: not connected ({queued.priority.name.lower()})"] += 1
            queue.clear()
        self._bytes = 0

    def _drop(self, dropped: QueuedFrame, why: str) -> None:
        self._bytes -= len(dropped.frame)
        self._counts[f"to the vehicle: {why} ({dropped.priority.name.lower()})"] += 1
