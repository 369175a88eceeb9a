"""What waits to go out on the wire: little, by priority, and never old. Pure.

A pose or a setpoint that waited is not late, it is wrong: the autopilot takes it for now.
"""

from __future__ import annotations

from collections import Counter, deque
from enum import IntEnum
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

LIMIT_BYTES = 8192
OLDEST_S = 1.0


class Kind(IntEnum):
    """First things first."""

    PANIC = 0
    ROUTER = 1
    SIMULATOR = 2
    VISION = 3


# How many of a message may wait: a newer one takes the place of the oldest. PX4 stamps each on arrival, so two that arrive
# together would stand at one instant.
_NEWEST = {
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 1,
    mavlink.MAVLINK_MSG_ID_HIL_SENSOR: 1,
    mavlink.MAVLINK_MSG_ID_HIL_GPS: 1,
}


class Waiting(NamedTuple):
    frame: bytes
    msgid: int
    since: float
    kind: Kind


class Outbox:
    """counts: what did not go out, by reason."""

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self._queues: dict[Kind, deque[Waiting]] = {kind: deque() for kind in Kind}
        self._bytes = 0

    def __len__(self) -> int:
        return sum(map(len, self._queues.values()))

    def put(self, kind: Kind, frame: bytes, msgid: int, now: float) -> None:
        queue = self._queues[kind]
        if (most := _NEWEST.get(msgid)) is not None and sum(w.msgid == msgid for w in queue) >= most:
            oldest = next(w for w in queue if w.msgid == msgid)
            queue.remove(oldest)
            self._lose(oldest, "overtaken by a newer one")
        queue.append(Waiting(frame, msgid, now, kind))
        self._bytes += len(frame)
        while self._bytes > LIMIT_BYTES:
            last = next(k for k in reversed(Kind) if self._queues[k])
            self._lose(self._queues[last].popleft(), "wire full")

    def take(self, now: float) -> Waiting | None:
        """The next to go out, or None when nothing waits."""
        for queue in self._queues.values():
            while queue:
                found = queue.popleft()
                if now - found.since <= OLDEST_S:
                    self._bytes -= len(found.frame)
                    return found
                self._lose(found, "waited too long")
        return None

    def clear(self) -> None:
        """The wire is away: nothing of now may be obeyed when it is back."""
        for queue in self._queues.values():
            for waiting in queue:
                self._counts[f"to the vehicle: wire away ({waiting.kind.name.lower()})"] += 1
            queue.clear()
        self._bytes = 0

    def _lose(self, lost: Waiting, why: str) -> None:
        self._bytes -= len(lost.frame)
        self._counts[f"to the vehicle: {why} ({lost.kind.name.lower()})"] += 1
