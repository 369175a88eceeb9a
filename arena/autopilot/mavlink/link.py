"""MAVLink link of a vehicle: the queue of frames to send, and the schedule of the streams. No sockets, no clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.kernels.stream_schedule import StreamSchedule
from arena.wire.mavlink_codec import Codec

_QUEUE_LIMIT = 256  # entries
_TEXT_BYTES = 50  # of one STATUSTEXT
Sequences = NDArray[np.int64]


class LinkStreams:
    """Streamed messages of one link, and the time at which each message is due.

    schedule: of all links of all vehicles
    row: row of this link in the schedule
    columns: message id -> column in the schedule
    """

    def __init__(self, schedule: StreamSchedule, row: int, columns: Mapping[int, int]) -> None:
        self._schedule, self._row, self._columns = schedule, row, columns

    def set_interval(self, msgid: int, interval_s: float, first_s: float) -> None:
        """Set the interval at which a message is sent on this link.

        interval_s: period [s], 0 stops the stream
        first_s: time of the first message [s]
        """
        self._schedule.set_interval(self._row, self._columns[msgid], interval_s, first_s)

    def interval(self, msgid: int) -> float:
        """Return the period at which a message is streamed on this link [s]; 0 if the message is not streamed."""
        column = self._columns.get(msgid)
        return 0.0 if column is None else self._schedule.interval_s[self._row, column]

    def take_due(self, now: float) -> list[int]:
        """Return the ids of the messages that are due at `now` [s], and schedule the next ones."""
        ids = self._schedule.ids
        return [ids[column] for column in self._schedule.take_due(self._row, now)]


class MavlinkLink:
    """MAVLink link of a vehicle: the frames to send, and its streams.

    name: `router` (to the MAVLink router), `vision` (to the pose forwarder), `panic` (reserved for land-all, kill-all and
        the copilot) or `ground` (to the MAVLink router, for ground stations)
    queue: frames to send; an entry may contain several
    gcs_heartbeat_at: time of the last ground station heartbeat on this link [s]
    waiting: no message has arrived yet, and the link sends only HEARTBEAT until then
    row: row of the link in the tables of all links
    text_id: number of the last text
    """

    def __init__(
        self, name: str, system_id: int, streams: LinkStreams, sequences: Sequences, row: int
    ) -> None:
        """Create a link that counts its MAVLink frames in an element of `sequences`.

        `sequences[row]` is the sequence number of the link's next frame. The kernel of the streams counts the same number.
        """
        self.name, self.streams = name, streams
        self.codec = Codec(system_id, 1, _Sender(system_id, sequences, row))
        self.queue: list[bytes] = []
        self.gcs_heartbeat_at = -1e9
        self.waiting = False
        self.row, self.text_id = row, 0

    def send(self, message: Any) -> None:
        """Queue a message, or drop the message if the queue is full.

        A link that waits for its first message drops everything. None is ignored.
        """
        if message is not None and not self.waiting and len(self.queue) < _QUEUE_LIMIT:
            self.queue.append(self.codec.pack(message))

    def send_text(self, severity: int, text: str) -> None:
        """Queue a text as STATUSTEXT. A long text is split into numbered chunks.

        severity: MAV_SEVERITY
        """
        raw = text.encode(errors="replace")
        chunks = [raw[k : k + _TEXT_BYTES] for k in range(0, len(raw), _TEXT_BYTES)]
        self.text_id = self.text_id % 65535 + 1
        number = self.text_id if len(chunks) > 1 else 0
        for k, chunk in enumerate(chunks):
            self.send(mavlink.MAVLink_statustext_message(severity, chunk, number, k))

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


class _Sender(mavlink.MAVLink):  # type: ignore[misc]
    """MAVLink encoder (pymavlink) of one link. It reads and writes its sequence number in an array of all links."""

    def __init__(self, system_id: int, sequences: Sequences, row: int) -> None:
        self._sequences, self._row = sequences, row
        super().__init__(None, srcSystem=system_id, srcComponent=1)

    @property
    def seq(self) -> int:
        return int(self._sequences[self._row])

    @seq.setter
    def seq(self, value: int) -> None:
        self._sequences[self._row] = value
