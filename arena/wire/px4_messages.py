"""Encoders and decoders of PX4 messages that are not in pymavlink's `common` dialect.

    ESC_INFO (290)                <Q 4I H 4H 4h 4B    time_usec, errors, counter, failures, temperature, index, count, connection, info
    ESC_STATUS (291)              <Q 4i 4f 4f B       time_usec, rpm, voltage, current, index
    PROTOCOL_VERSION (300)        <3H 8s 8s           version, min_version, max_version, hashes of specification and library
    COMPONENT_INFORMATION (395)   <3I 100s 100s       time_boot_ms, two checksums, two URIs
    COMPONENT_METADATA (397)      <2I 100s            time_boot_ms, file_crc, uri
    EVENT (410)                   <2I H 3B 40s        id, time_boot_ms, sequence, destination component and system, log levels, arguments
    CURRENT_EVENT_SEQUENCE (411)  <H B                sequence, flags
    REQUEST_EVENT (412)           <2H 2B              first_sequence, last_sequence, target system and component
    RESPONSE_EVENT_ERROR (413)    <2H 3B              sequence, oldest available sequence, target system and component, reason
    AVAILABLE_MODES_MONITOR (437) <B                  seq

`px4_mode` contains the messages about modes.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

from arena.wire.mavlink_frame import SEEDS, Buffer, Frame, MavlinkSender, pack_frame
from arena.wire.px4_mode import CURRENT_MODE

ESC_INFO, ESC_STATUS, PROTOCOL_VERSION = 290, 291, 300
COMPONENT_INFORMATION, COMPONENT_METADATA = 395, 397
EVENT, CURRENT_EVENT_SEQUENCE, REQUEST_EVENT, RESPONSE_EVENT_ERROR = 410, 411, 412, 413
AVAILABLE_MODES_MONITOR = 437
SEQUENCE_RESET = 1
"""MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET: the numbering of the events begins again."""
ESCS_PER_MESSAGE = 4
FIELDS = {
    ESC_INFO: (
        "Q time_usec, 4I error_count, H counter, 4H failure_flags, 4h temperature, B index, B count, "
        "B connection_type, B info"
    ),
    ESC_STATUS: "Q time_usec, 4i rpm, 4f voltage, 4f current, B index",
    CURRENT_EVENT_SEQUENCE: "H sequence, B flags",
    CURRENT_MODE: "I custom_mode, I intended_custom_mode, B standard_mode",
}
"""Types and names of the fields in wire order, for messages that are packed by a table of fields."""
_LAYOUTS = {
    PROTOCOL_VERSION: struct.Struct("<3H8s8s"),
    COMPONENT_INFORMATION: struct.Struct("<3I100s100s"),
    COMPONENT_METADATA: struct.Struct("<2I100s"),
    EVENT: struct.Struct("<2IH3B40s"),
    REQUEST_EVENT: struct.Struct("<2H2B"),
    RESPONSE_EVENT_ERROR: struct.Struct("<2H3B"),
    AVAILABLE_MODES_MONITOR: struct.Struct("<B"),
}


class Px4Message(NamedTuple):
    """PX4 message with its encoded payload. Its method `pack` is called like that of pymavlink's messages.

    msgid: message id
    payload: encoded fields
    """

    msgid: int
    payload: bytes

    def pack(self, sender: MavlinkSender) -> bytes:
        """Return the frame. The caller increases the sequence number of `sender`."""
        return pack_frame(self.msgid, self.payload, sender, SEEDS[self.msgid])


def px4_crc32(data: bytes, crc: int = 0) -> int:
    """Return the CRC-32 of data as PX4 computes it: it begins with 0 and is not inverted.

    `zlib.crc32` inverts it twice.

    crc: checksum of the data before
    """
    return ~zlib.crc32(data, ~crc & 0xFFFFFFFF) & 0xFFFFFFFF


class EventRequest(NamedTuple):
    """Contents of REQUEST_EVENT: the numbers of the first and last requested event, and the addressed system and component."""

    first: int
    last: int
    target_system: int
    target_component: int


def _message(msgid: int, *values: float | bytes) -> Px4Message:
    return Px4Message(msgid, _LAYOUTS[msgid].pack(*values))


def read_event_request(data: Buffer, at: Frame) -> EventRequest:
    """Decode REQUEST_EVENT, the request of a ground station for events that it has missed."""
    layout = _LAYOUTS[REQUEST_EVENT]
    payload = bytes(data[at.payload : at.payload + min(at.size, layout.size)])
    return EventRequest(*layout.unpack(payload.ljust(layout.size, b"\0")))


def protocol_version() -> Px4Message:
    """Return PROTOCOL_VERSION, which reports MAVLink 2 with support of MAVLink 1."""
    return _message(PROTOCOL_VERSION, 200, 100, 200, b"", b"")


def component_metadata(time_ms: int, uri: str, crc: int) -> Px4Message:
    """Return COMPONENT_METADATA, which names the file that describes the autopilot.

    time_ms: time since boot [ms].  uri: place of the file.  crc: its CRC-32 (`px4_crc32`)
    """
    return _message(COMPONENT_METADATA, time_ms, crc, uri.encode())


def component_information(time_ms: int, uri: str, crc: int) -> Px4Message:
    """Return COMPONENT_INFORMATION, the older form of COMPONENT_METADATA."""
    return _message(COMPONENT_INFORMATION, time_ms, crc, 0, uri.encode(), b"")


def event(number: int, time_ms: int, sequence: int, levels: int, arguments: bytes) -> Px4Message:
    """Return EVENT, PX4's report of an event, addressed to every system and component.

    number: id of the event
    time_ms: time of the event since boot [ms]
    levels: log levels in logs (upper 4 bits) and for ground stations (lower 4 bits)
    """
    return _message(EVENT, number, time_ms & 0xFFFFFFFF, sequence, 0, 0, levels, arguments)


def response_event_error(sequence: int, oldest: int, system: int, component: int) -> Px4Message:
    """Return RESPONSE_EVENT_ERROR, the reply that a requested event is not available.

    sequence: the requested event.  oldest: the oldest event that is available.  system, component: the client
    """
    return _message(RESPONSE_EVENT_ERROR, sequence, oldest, system, component, 0)


def available_modes_monitor() -> Px4Message:
    """Return AVAILABLE_MODES_MONITOR. The list of modes never changes, so its number is 0."""
    return _message(AVAILABLE_MODES_MONITOR, 0)
