"""Types of the results of `mavlink_framing`, the kernel that finds MAVLink frames.

Other packages import the types from `arena.wire.mavlink_frame`.
"""

from __future__ import annotations

from typing import NamedTuple


class Frame(NamedTuple):
    """A MAVLink frame in a buffer: its byte range, message id, sender and target.

    start, end: byte range with magic, CRC and signature
    payload, size: offset and length of the payload as sent
    sysid, compid: sender
    target_sys, target_comp: 0 if the message has no target, or is for all
    """

    start: int
    end: int
    payload: int
    size: int
    sysid: int
    compid: int
    msgid: int
    target_sys: int
    target_comp: int


class ParsedFrames(NamedTuple):
    """Result of parsing a datagram: its MAVLink frames, and counts of garbage, CRC errors and unknown messages.

    garbage: number of bytes that belong to no frame
    bad_crc: number of frames of a known message with a wrong CRC
    unknown: number of frames whose message is not in the table; they are accepted because their length fits
    """

    frames: list[Frame]
    garbage: int
    bad_crc: int
    unknown: int
