"""MAVLink link of a vehicle: the queue of frames to send, and the schedule of the streams. No sockets, no clock."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from arena.wire.mavlink_codec import Codec

_QUEUE_LIMIT = 256  # entries
_CATCH_UP_S = 0.1  # a late stream skips messages that are older than this
_ROUNDING_S = 1e-6


@dataclass(slots=True)
class MavlinkLink:
    """MAVLink link of a vehicle: the frames to send, and the schedule of its streams.

    name: `router` (to the MAVLink router), `vision` (to the pose forwarder) or `panic` (reserved for land-all, kill-all and
        the copilot)
    queue: frames to send; an entry may contain several
    intervals: period of each scheduled message [s], by message id
    schedule: heap of (time [s], message id), one entry per scheduled message
    gcs_heartbeat_at: time of the last ground station heartbeat on this link [s]
    """

    name: str
    codec: Codec
    queue: list[bytes] = field(default_factory=list)
    intervals: dict[int, float] = field(default_factory=dict)
    schedule: list[tuple[float, int]] = field(default_factory=list)
    gcs_heartbeat_at: float = -1e9

    def set_interval(self, msgid: int, interval_s: float, first_s: float) -> None:
        """Set the interval at which a message is sent.

        interval_s: period [s], 0 stops the stream
        first_s: time of the first message [s]
        """
        self.intervals[msgid] = interval_s
        self.schedule = [entry for entry in self.schedule if entry[1] != msgid]
        if interval_s > 0:
            self.schedule.append((first_s, msgid))
        heapq.heapify(self.schedule)

    def next_due(self) -> float:
        """Return the time of the next scheduled message [s], infinite if there is none."""
        return self.schedule[0][0] if self.schedule else math.inf

    def take_due(self, now: float) -> list[int]:
        """Return the ids of the messages that are due at `now` [s], and schedule each of these messages again."""
        schedule, until, oldest = self.schedule, now + _ROUNDING_S, now - _CATCH_UP_S
        due: list[int] = []
        while schedule and schedule[0][0] <= until:
            when, msgid = schedule[0]
            due.append(msgid)
            again = when + self.intervals[msgid]
            heapq.heapreplace(schedule, (again if again > oldest else oldest, msgid))
        return due

    def send(self, message: Any) -> None:
        """Queue a message, or drop it if the queue is full. If `message` is None, do nothing."""
        if message is not None and len(self.queue) < _QUEUE_LIMIT:
            self.queue.append(self.codec.pack(message))

    def send_frames(self, count: int, pack: Callable[[int], bytes]) -> None:
        """Queue several frames, or drop them if the queue is full.

        count: number of frames
        pack: function of the first frame's sequence number; returns all frames as bytes
        """
        if len(self.queue) < _QUEUE_LIMIT:
            self.queue.append(pack(self.codec.take_sequence(count)))

    def take_datagram(self) -> bytes:
        """Remove all queued frames and return them as one datagram."""
        datagram, self.queue = b"".join(self.queue), []
        return datagram
