"""Summary of a log file: topics, number of messages, rates, gaps, and whether the file is complete."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from arena.errors import InputError
from arena.flight_log.open import read_flights
from arena.flight_log.recording import MCAP_MAGIC, Recording, later_parts
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_layout import message_name
from arena.wire.ulog import MAGIC as ULOG_MAGIC

_MESSAGES = 20
GAP_S = 0.5
"""A gap is a time between two messages above this value [s], and above five times the usual one."""


@dataclass
class Stream:
    """Number, rate and gaps of the messages of one topic in a log file.

    name: topic, or topic and message.  count: number of messages.  first_s, last_s: times of the first and the last one [s].
    longest_s: longest time between two messages [s].  gaps: number of gaps, see GAP_S.
    """

    name: str
    count: int = 0
    first_s: float = math.nan
    last_s: float = math.nan
    longest_s: float = 0.0
    _long: list[float] = field(default_factory=list, repr=False)

    def add(self, time_s: float) -> None:
        """Count a message of this topic. time_s: time of the message [s]."""
        if self.count:
            between = time_s - self.last_s
            self.longest_s = max(self.longest_s, between)
            if between > GAP_S:
                self._long.append(between)
        else:
            self.first_s = time_s
        self.count += 1
        self.last_s = time_s

    @property
    def rate_hz(self) -> float:
        """Mean message rate [Hz]; NaN for fewer than two messages."""
        span = self.last_s - self.first_s
        return (self.count - 1) / span if self.count > 1 and span > 0 else math.nan

    @property
    def gaps(self) -> int:
        """Number of gaps: intervals that are longer than `GAP_S` and longer than five mean intervals."""
        usual = 1.0 / self.rate_hz if math.isfinite(self.rate_hz) else math.inf
        return sum(between > 5.0 * usual for between in self._long)


@dataclass(frozen=True, kw_only=True)
class LogInfo:
    """Summary of a log file: format, size, topics, and what is missing.

    path: the file.  kind: format of the file.  size_bytes: of the file, with its later parts.
    facts: lines about the whole file.  incomplete: "" if the file ended cleanly, else what is missing.
    streams: topics, in alphabetical order.  messages: number of messages; of rows in a CSV file.
    """

    path: Path
    kind: str
    size_bytes: int
    facts: Sequence[str]
    incomplete: str
    streams: Sequence[Stream]
    messages: int

    @property
    def length_s(self) -> float:
        """Time from the first to the last message [s]; NaN without messages."""
        known = [stream for stream in self.streams if stream.count]
        if not known:
            return math.nan
        return max(stream.last_s for stream in known) - min(stream.first_s for stream in known)


def log_info(path: Path, *, brief: bool = False) -> LogInfo:
    """Return the summary of a log file: `flight.mcap`, a ULog, or a CSV log.

    Raises InputError for other files.

    brief: do not count the MAVLink messages of each type.
    """
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise InputError(
            f"{path}: {error.strerror}, expected a log file: flight.mcap, .ulg or .csv"
        ) from error
    if head.startswith(MCAP_MAGIC):
        return _record(path, brief)
    return _ulog(path) if head.startswith(ULOG_MAGIC) else _csv(path)


def _record(path: Path, brief: bool) -> LogInfo:
    recording = Recording(path)
    parts = (path, *later_parts(path))
    streams: dict[str, Stream] = {}
    count = 0
    for topic, time_s, data in recording.messages():
        _stream(streams, topic).add(time_s)
        count += 1
        if not brief and topic.endswith(("/mavlink/down", "/mavlink/up")):
            for frame in parse_frames(data).frames:
                sender = f"{frame.sysid}/{frame.compid}"
                _stream(streams, f"{topic} {message_name(frame.msgid)} ({sender})").add(time_s)
    vehicles = ", ".join(f"{v.name} ({v.autopilot if v.simulated else 'real'})" for v in recording.vehicles)
    started = datetime.fromtimestamp(recording.start_unix_s).astimezone().isoformat(" ", "seconds")
    facts = [f"arena {recording.name}: {vehicles}", f"started {started}; times are {recording.clock} time"]
    if len(parts) > 1:
        facts.append(
            f"the recorder was restarted: the record continues in {', '.join(p.name for p in parts[1:])}"
        )
    cut = [part.name for part in parts if not _has_end(part)]
    incomplete = f"{', '.join(cut)} has no end: the recorder was killed, or is still recording" if cut else ""
    if recording.damaged_chunks:
        incomplete = (
            f"{incomplete or 'the file has its end'}; {recording.damaged_chunks} damaged chunks were skipped"
        )
    return LogInfo(
        path=path,
        kind="record of an arena (MCAP)",
        size_bytes=sum(part.stat().st_size for part in parts),
        facts=facts,
        incomplete=incomplete,
        streams=[streams[name] for name in sorted(streams)],
        messages=count,
    )


def _stream(streams: dict[str, Stream], name: str) -> Stream:
    found = streams.get(name)
    if found is None:
        found = streams[name] = Stream(name)
    return found


def _has_end(path: Path) -> bool:
    """Return whether an MCAP file was closed correctly, which means that it ends with the magic bytes."""
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - len(MCAP_MAGIC)))
        return file.read() == MCAP_MAGIC and file.tell() > 2 * len(MCAP_MAGIC)


def _ulog(path: Path) -> LogInfo:
    from arena.flight_log.px4_ulog import load_ulog  # imported only here: pyulog is needed only here

    log = load_ulog(path)
    streams = []
    for topic in sorted(log.data_list, key=lambda found: (found.name, found.multi_id)):
        instance = f" {topic.multi_id}" if topic.multi_id else ""
        stream = Stream(f"{topic.name}{instance}")
        for stamp in topic.data["timestamp"].tolist():
            stream.add(stamp * 1e-6)
        streams.append(stream)
    facts = [
        f"{name}: {log.msg_info_dict[name]}"
        for name in ("ver_hw", "sys_name", "ver_sw")
        if name in log.msg_info_dict
    ]
    facts.append(
        f"parameters: {len(log.initial_parameters)}, changed in flight: {len(log.changed_parameters)}"
    )
    facts += [f"message: {message.message}" for message in log.logged_messages[:_MESSAGES]]
    if len(log.logged_messages) > _MESSAGES:
        facts.append(f"{len(log.logged_messages) - _MESSAGES} more messages")
    lost_s = sum(dropout.duration for dropout in log.dropouts) * 1e-3
    incomplete = f"{len(log.dropouts)} dropouts, {lost_s:.2f} s of data were lost" if log.dropouts else ""
    if log.file_corruption:
        incomplete = f"{incomplete + '; ' if incomplete else ''}parts of the file are damaged"
    return LogInfo(
        path=path,
        kind="PX4 log (ULog)",
        size_bytes=path.stat().st_size,
        facts=facts,
        incomplete=incomplete,
        streams=streams,
        messages=sum(stream.count for stream in streams),
    )


def _csv(path: Path) -> LogInfo:
    (flight,) = read_flights(path)
    times = flight.numbers["time.seconds"]
    streams = []
    for name, values in sorted(flight.numbers.items()):
        stream = Stream(name)
        for time_s in times[~np.isnan(values)].tolist():
            stream.add(time_s)
        streams.append(stream)
    with path.open("rb") as file:
        file.seek(-1, 2)
        cut = file.read() != b"\n"
    return LogInfo(
        path=path,
        kind="table (CSV)",
        size_bytes=path.stat().st_size,
        facts=[f"{flight.t.size} rows, {len(flight.numbers)} columns of numbers"],
        incomplete="the last row is incomplete" if cut else "",
        streams=streams,
        messages=int(flight.t.size),
    )
