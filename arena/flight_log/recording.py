"""Reader of `flight.mcap`: MAVLink datagrams, motion-capture frames, true states and events of a flight.

It also reads the record of a recorder that was killed: all complete chunks of the file, then those of its tail
(`arena.recorder.mcap_file`). `arena.wire.flight_record` describes the messages.
"""

from __future__ import annotations

import functools
import json
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from arena.errors import InputError
from arena.geometry import Array
from arena.wire.flight_record import (
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    METADATA,
    TAIL_METADATA,
    TAIL_START,
    TRUE_STATE_BYTES,
    RecordedBody,
    RecordedFrame,
    RecordedVehicle,
    down_topic,
    tail_path,
    truth_topic,
    unpack_frame,
    up_topic,
)

__all__ = [
    "RecordedBody",
    "RecordedDatagram",
    "RecordedEvent",
    "RecordedFrame",
    "RecordedMessage",
    "RecordedVehicle",
    "Recording",
    "TrueStates",
]

MCAP_MAGIC = b"\x89MCAP0\r\n"
_RECORD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<BQHIQQ")
_CHANNEL, _MESSAGE_CODE, _CHUNK, _METADATA, _DATA_END = 0x04, 0x05, 0x06, 0x0C, 0x0F


class RecordedMessage(NamedTuple):
    """A message in the record of a flight, as bytes that are not decoded.

    topic: name of its channel. time_s: time on the run's clock [s]. data: bytes of the message.
    """

    topic: str
    time_s: float
    data: bytes


class RecordedDatagram(NamedTuple):
    """A MAVLink datagram in the record of a flight.

    time_s: time of reception [s]. up: True if the datagram was sent to the vehicle. data: one or more MAVLink
    frames.
    """

    time_s: float
    up: bool
    data: bytes


class RecordedEvent(NamedTuple):
    """A line of events.jsonl in the record of a flight.

    time_s: time on the run's clock [s]. process: name of the process, "" if none. fields: the whole line.
    """

    time_s: float
    process: str
    fields: Mapping[str, Any]

    @property
    def text(self) -> str:
        """Text of the event; "" for a line without text, such as a change of a process state."""
        return str(self.fields.get("event", ""))


@dataclass(frozen=True, kw_only=True)
class TrueStates:
    """True states (position, velocity, attitude, body rates) of one simulated vehicle at n instants.

    t: time on the run's clock [s] (n,).  p_n: position of the body origin [m] [NED] (n, 3).  v_n: velocity [m/s] [NED] (n, 3).
    q_nb: attitude [-] wxyz (n, 4).  omega_b: body rates [rad/s] [FRD] (n, 3).
    """

    t: Array
    p_n: Array
    v_n: Array
    q_nb: Array
    omega_b: Array


DRAWN = ("fence", "obstacles")
"""Keys of the recorder's configuration (slice) that describe what is drawn in the room: geofence, None without one, and obstacles."""


class Recording:
    """Reader of the record of one flight.

    Every method reads the file again, so a large record needs little memory.

    path: flight.mcap. If the recorder was restarted in the run, the record continues in flight.2.mcap, flight.3.mcap, ... beside it.
    name: name of the arena.  clock: `simulation` or `unix`.  size_m: size of the room, north, east, height [m].
    start_s, start_unix_s: start of the record, by the run's clock and as Unix time [s].
    vehicles: vehicles of the arena, in its order.
    drawn: the keys `DRAWN` of the recorder's configuration (slice). Old records lack them.
    damaged_chunks: number of damaged chunks that were skipped, such as the last one after a loss of power.
    Raises InputError if the file cannot be read or is not the record of an arena.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._damaged: set[tuple[Path, int]] = set()
        found = self._metadata()
        try:
            self.name, self.clock = found["name"], found["clock"]
            self.start_s, self.start_unix_s = float(found["start_s"]), float(found["start_unix_s"])
            north, east, height = json.loads(found["size_m"])
            self.size_m = (float(north), float(east), float(height))
            self.drawn: dict[str, Any] = {key: json.loads(found[key]) for key in DRAWN if key in found}
            self.vehicles = tuple(RecordedVehicle(**v) for v in json.loads(found["vehicles"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{self.path}: this is not the record of an arena: its metadata `{METADATA}` lack the key {error}"
            ) from error

    @property
    def damaged_chunks(self) -> int:
        return len(self._damaged)

    @functools.cached_property
    def topics(self) -> tuple[str, ...]:
        """Return the topics that have messages, in alphabetical order.

        The first call reads the whole file.
        """
        return tuple(sorted({message.topic for message in self.messages()}))

    def messages(self, topics: Collection[str] | None = None) -> Iterator[RecordedMessage]:
        """Yield the messages of the given topics in the order of recording.

        topics: None for all topics.
        """
        for file in record_files(self.path):
            yield from self._messages(file, topics)

    def datagrams(self, vehicle: str) -> Iterator[RecordedDatagram]:
        """Yield the MAVLink datagrams from and to a vehicle in the order of recording."""
        down, up = down_topic(vehicle), up_topic(vehicle)
        for topic, time_s, data in self.messages((down, up)):
            yield RecordedDatagram(time_s, topic == up, data)

    def frames(self) -> Iterator[RecordedFrame]:
        """Yield the frames of motion capture in the order of recording."""
        for _, time_s, data in self.messages((FRAMES_TOPIC,)):
            yield unpack_frame(time_s, data)

    def truth(self, vehicle: str) -> TrueStates:
        """Return the recorded true states of a vehicle; for a real vehicle, the arrays are empty."""
        found = [
            (m.time_s, m.data)
            for m in self.messages((truth_topic(vehicle),))
            if len(m.data) == TRUE_STATE_BYTES
        ]
        rows = (
            np.frombuffer(b"".join(data[4:] for _, data in found), "<f8").reshape(-1, 13).astype(np.float64)
        )
        return TrueStates(
            t=np.array([t for t, _ in found], np.float64),
            p_n=rows[:, 0:3],
            v_n=rows[:, 3:6],
            q_nb=rows[:, 6:10],
            omega_b=rows[:, 10:13],
        )

    def events(self) -> Iterator[RecordedEvent]:
        """Yield the lines of events.jsonl. A line that is not a JSON object is skipped."""
        for _, time_s, data in self.messages((EVENTS_TOPIC,)):
            try:
                fields = json.loads(data)
            except ValueError:
                continue
            if isinstance(fields, dict):
                yield RecordedEvent(time_s, str(fields.get("process", "")), fields)

    def _messages(self, path: Path, topics: Collection[str] | None) -> Iterator[RecordedMessage]:
        wanted: dict[int, str] = {}
        for at, code, data in _records(path):
            if code != _CHUNK:
                yield from _messages_in(_RECORD.pack(code, len(data)) + data, topics, wanted)
            elif (records := _unpacked(data)) is not None:
                yield from _messages_in(records, topics, wanted)
            else:
                self._damaged.add((path, at))

    def _metadata(self) -> dict[str, str]:
        found = _metadata_of(self.path, METADATA)
        if found is None:
            raise InputError(
                f"{self.path}: this is not the record of an arena: it has no metadata `{METADATA}`"
            )
        return found


def record_files(path: Path) -> tuple[Path, ...]:
    """Return the files that contain the messages of a record, in the order of recording.

    These are its parts, and the tail file of each part whose end is missing.
    """
    return tuple(file for part in (path, *later_parts(path)) for file in (part, *_tail_of(part)))


def later_parts(path: Path) -> tuple[Path, ...]:
    """Return the files that restarted recorders have added to a record: flight.2.mcap, flight.3.mcap, ..."""
    found, number = [], 2
    while (part := path.with_suffix(f".{number}{path.suffix}")).exists():
        found.append(part)
        number += 1
    return tuple(found)


def _tail_of(part: Path) -> tuple[Path, ...]:
    """Return the `.tail` file with the last messages of an MCAP file; () if it is missing or not needed.

    It is not needed if the MCAP file itself contains these messages. part: path of the MCAP file.
    """
    tail = tail_path(part)
    try:
        found = _metadata_of(tail, TAIL_METADATA)
        at = int((found or {})[TAIL_START])
        with part.open("rb") as file:
            file.seek(at)
            head = file.read(_RECORD.size)
            code, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, 0)
            is_written = code == _DATA_END or (code == _CHUNK and _unpacked(file.read(length)) is not None)
    except (OSError, InputError, KeyError, ValueError):  # no tail, or one that was just begun
        return ()
    return () if is_written else (tail,)


def _metadata_of(path: Path, name: str) -> dict[str, str] | None:
    """Return the content of the MCAP metadata record `name`, or None if the file has no such record.

    Raises InputError if the file is not MCAP.
    """
    for _, code, data in _records(path):
        if code == _METADATA:
            found_name, found = _read_metadata(data)
            if found_name == name:
                return found
    return None


def _records(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Yield (position in the file, record code, content) of each complete MCAP record in the data section.

    Only records that this module uses are read; others are skipped. Raises InputError if the file is not MCAP.
    """
    try:
        with path.open("rb") as file:
            if file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
                raise InputError(f"{path}: this is not an MCAP file")
            yield from _records_of(file, path.stat().st_size)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _records_of(file: IO[bytes], size: int) -> Iterator[tuple[int, int, bytes]]:
    while len(head := file.read(_RECORD.size)) == _RECORD.size:
        code, length = _RECORD.unpack(head)
        at = file.tell()
        # A writer that was killed leaves an incomplete record, a loss of power zeros.
        if code in (0, _DATA_END) or at + length > size:
            return
        if code in (_CHANNEL, _MESSAGE_CODE, _CHUNK, _METADATA):
            yield at, code, file.read(length)
        else:
            file.seek(length, 1)


def _messages_in(
    records: bytes, topics: Collection[str] | None, wanted: dict[int, str]
) -> Iterator[RecordedMessage]:
    """Yield the messages of selected topics in a block of MCAP records.

    wanted: {channel id: topic}. The function adds the channels of `topics` (None: all topics) when it finds
    them.
    """
    at, end = 0, len(records)
    while at + _RECORD.size <= end:
        code, length = _RECORD.unpack_from(records, at)
        if code == _MESSAGE_CODE:
            _, _, channel, _, log_time, _ = _MESSAGE.unpack_from(records, at)
            if (topic := wanted.get(channel)) is not None:
                data = records[at + _MESSAGE.size : at + _RECORD.size + length]
                yield RecordedMessage(topic, log_time / 1e9, data)
        elif code == _CHANNEL:
            number, topic = _read_channel(records[at + _RECORD.size : at + _RECORD.size + length])
            if topics is None or topic in topics:
                wanted[number] = topic
        at += _RECORD.size + length


def _unpacked(chunk: bytes) -> bytes | None:
    """Return the decompressed records in an MCAP chunk, or None if the chunk is damaged."""
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import EndOfFile
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream
    from zstandard import ZstdError

    try:
        stream, size = get_chunk_data_stream(Chunk.read(ReadDataStream(BytesIO(chunk))), validate_crc=True)
    except (EndOfFile, RuntimeError, ValueError, struct.error, ZstdError):
        return None
    return stream.read(size)


def _read_channel(data: bytes) -> tuple[int, str]:
    """Return (id, topic) of an MCAP channel record."""
    number, _, length = struct.unpack_from("<HHI", data)
    return number, str(data[8 : 8 + length], "utf-8")


def _read_metadata(data: bytes) -> tuple[str, dict[str, str]]:
    from mcap.data_stream import ReadDataStream
    from mcap.records import Metadata

    found = Metadata.read(ReadDataStream(BytesIO(data)))
    return found.name, dict(found.metadata)
