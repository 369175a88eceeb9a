"""Encoder and decoder for MAVLink's messages about log files. No sockets, no clocks.

LOG_REQUEST_LIST (117)  <H H B B        first and last log, system, component
LOG_ENTRY (118)         <I I H H H      time [Unix s], size [byte], log, number of logs, last log
LOG_REQUEST_DATA (119)  <I I H B B      offset, count [byte], log, system, component
LOG_DATA (120)          <I H B 90s      offset [byte], log, count, data
LOG_REQUEST_END (122)   <B B            system, component
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame

REQUEST_LIST, ENTRY, REQUEST_DATA, DATA, REQUEST_END = 117, 118, 119, 120, 122
DATA_BYTES = 90
"""Largest number of bytes of a log that one LOG_DATA message carries."""
_LAST = 0xFFFF
_LIST, _ENTRY, _REQUEST, _DATA = (
    struct.Struct(s) for s in ("<HHBB", "<IIHHH", "<IIHBB", f"<IHB{DATA_BYTES}s")
)
Message = tuple[int, bytes]
"""A message that is not packed into a frame yet: (message id, payload)."""


class LogEntry(NamedTuple):
    """A log file of a vehicle, as LOG_ENTRY reports it.

    number: id of the log in requests
    size: [byte]
    time_s: time of the last change [Unix s]; 0 if the vehicle does not know the date
    logs: number of logs of the vehicle; 0 if it has none, and then all other fields are without meaning
    """

    number: int
    size: int
    time_s: int
    logs: int


class LogData(NamedTuple):
    """Part of a log file, as LOG_DATA contains it.

    number: id of the log.
    offset: position of the first byte.
    """

    number: int
    offset: int
    data: bytes


def parse_entry(data: Buffer, frame: Frame) -> LogEntry:
    """Decode LOG_ENTRY, which describes one log file of a vehicle."""
    time_s, size, number, logs, _ = _ENTRY.unpack(_payload(data, frame, _ENTRY.size))
    return LogEntry(number, size, time_s, logs)


def parse_data(data: Buffer, frame: Frame) -> LogData:
    """Decode LOG_DATA, which contains a part of a log file."""
    offset, number, count, raw = _DATA.unpack(_payload(data, frame, _DATA.size))
    return LogData(number, offset, raw[: min(count, DATA_BYTES)])


def request_list(system: int) -> Message:
    """Return LOG_REQUEST_LIST, the request for the list of all log files."""
    return REQUEST_LIST, _LIST.pack(0, _LAST, system, AUTOPILOT)


def request_data(system: int, number: int, offset: int, count: int) -> Message:
    """Return LOG_REQUEST_DATA, the request for a part of a log file.

    The vehicle then sends LOG_DATA until `count` bytes are sent.
    """
    return REQUEST_DATA, _REQUEST.pack(offset, count, number, system, AUTOPILOT)


def request_end(system: int) -> Message:
    """Return LOG_REQUEST_END, the request to stop sending LOG_DATA."""
    return REQUEST_END, bytes((system, AUTOPILOT))


def _payload(data: Buffer, frame: Frame, size: int) -> bytes:
    """Return `size` bytes of a payload; zeros replace the bytes that MAVLink 2 has truncated."""
    return bytes(data[frame.payload : frame.payload + min(frame.size, size)]).ljust(size, b"\0")
