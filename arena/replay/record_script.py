"""Messages of a replay, read from a record `flight.mcap` while they are sent.

A recorder logs true states up to 0.2 s after their time, and events up to seconds after it. They are sorted by time, and the
messages of one topic keep their order.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterable, Iterator, Mapping
from operator import itemgetter

import numpy as np

from arena.errors import InputError
from arena.flight_log.recording import RecordedMessage, Recording
from arena.replay.parameters import ParameterHistory, Stored
from arena.replay.script import NS, Item, Kind, RecordedLine, ScriptVehicle, TrueState, nanoseconds
from arena.wire.flight_record import (
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    TRUE_STATE_BYTES,
    down_topic,
    truth_topic,
    unpack_frame,
    up_topic,
)

SORTED_NS = 3 * NS
"""Longest time by which a message may be in the file after later ones, so that it is still sent at its time [ns]."""


def script_vehicles(recording: Recording) -> tuple[ScriptVehicle, ...]:
    """Return the vehicles of a record as `ScriptVehicle`, the form in which a replay describes them."""
    return tuple(
        ScriptVehicle(
            name=v.name, id=v.id, body=v.body, simulated=v.simulated, autopilot=v.autopilot, profile=v.profile
        )
        for v in recording.vehicles
    )


class RecordScript:
    """Source of a replay's messages: reads them from flight.mcap. Implements `arena.replay.script.Script`.

    recording: the record.  initial: vehicle -> its parameters at the start.  Raises InputError if the record has no message.
    """

    def __init__(
        self, recording: Recording, initial: Mapping[str, Mapping[str, Stored]] | None = None
    ) -> None:
        self._recording = recording
        self.vehicles = script_vehicles(recording)
        self.parameters = [ParameterHistory((initial or {}).get(v.name)) for v in self.vehicles]
        self._kinds: dict[str, tuple[Kind, int]] = {
            FRAMES_TOPIC: (Kind.FRAME, -1),
            EVENTS_TOPIC: (Kind.EVENT, -1),
        }
        for i, v in enumerate(self.vehicles):
            self._kinds |= {
                down_topic(v.name): (Kind.DOWN, i),
                up_topic(v.name): (Kind.UP, i),
                truth_topic(v.name): (Kind.TRUTH, i),
            }
        self._events: list[RecordedMessage] = []
        self.start_ns, self.end_ns, self.bodies = self._survey()

    def items(self, from_ns: int) -> Iterator[Item]:
        others = self._recording.messages(self._kinds.keys() - {EVENTS_TOPIC})
        for time_ns, message in heapq.merge(in_order(others), in_order(self._events), key=itemgetter(0)):
            if time_ns >= from_ns and (item := self._item(message, time_ns)) is not None:
                yield item

    def _item(self, message: RecordedMessage, time_ns: int) -> Item | None:
        """Convert a message of the record to an `Item` of the replay. Return None for a damaged message."""
        kind, vehicle = self._kinds[message.topic]
        if kind is Kind.FRAME:
            return Item(time_ns, kind, vehicle, unpack_frame(message.time_s, message.data))
        if kind is Kind.TRUTH:
            state = _true_state(message.data)
            return None if state is None else Item(time_ns, kind, vehicle, state)
        if kind is Kind.EVENT:
            line = _line(message.data)
            return None if line is None else Item(time_ns, kind, vehicle, line)
        return Item(time_ns, kind, vehicle, message.data)

    def _survey(self) -> tuple[int, int, frozenset[str]]:
        """Read the record once: return its first and last time [ns] and the names of all rigid bodies.

        The parameters and events of the record are stored.

        Frames of the same size have the same bodies, so only one frame of each size is decoded.
        """
        first: float | None = None
        last, sizes, bodies = 0.0, set[int](), set[str]()
        for message in self._recording.messages(self._kinds.keys()):
            kind, vehicle = self._kinds[message.topic]
            if kind is Kind.DOWN:
                self.parameters[vehicle].add(nanoseconds(message.time_s), message.data)
            elif kind is Kind.EVENT:
                self._events.append(message)
            first = message.time_s if first is None else min(first, message.time_s)
            last = max(last, message.time_s)
            if message.topic == FRAMES_TOPIC and len(message.data) not in sizes:
                sizes.add(len(message.data))
                bodies |= {body.name for body in unpack_frame(message.time_s, message.data).bodies}
        if first is None:
            raise InputError(
                f"{self._recording.path}: the record contains no messages, so it cannot be replayed"
            )
        return nanoseconds(first), nanoseconds(last), frozenset(bodies)


def in_order(messages: Iterable[RecordedMessage]) -> Iterator[tuple[int, RecordedMessage]]:
    """Yield (time [ns], message) sorted by time. Messages of one topic keep their order.

    The time of a message is never earlier than the time of the previous message of its topic.
    """
    waiting: list[tuple[int, int, RecordedMessage]] = []
    last: dict[str, int] = {}
    newest = 0
    for number, message in enumerate(messages):
        topic = message.topic
        time_ns = last[topic] = max(nanoseconds(message.time_s), last.get(topic, 0))
        newest = max(newest, time_ns)
        heapq.heappush(waiting, (time_ns, number, message))
        while waiting[0][0] <= newest - SORTED_NS:
            due_ns, _, due = heapq.heappop(waiting)
            yield due_ns, due
    while waiting:
        due_ns, _, due = heapq.heappop(waiting)
        yield due_ns, due


def _true_state(data: bytes) -> TrueState | None:
    if len(data) != TRUE_STATE_BYTES:
        return None
    row = tuple(np.frombuffer(data[4:], "<f8").tolist())
    return TrueState(row[0:3], row[3:6], row[6:10], row[10:13])


def _line(data: bytes) -> RecordedLine | None:
    try:
        fields = json.loads(data)
    except ValueError:
        return None
    return RecordedLine(data, fields) if isinstance(fields, dict) else None
