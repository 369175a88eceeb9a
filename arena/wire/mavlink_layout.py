"""Layout of the payloads of MAVLink messages, from pymavlink's dialect, and a fast decoder.

pymavlink's own decoder checks frame and CRC again and makes an object with all properties of the message. This takes about
four times as long.
"""

from __future__ import annotations

import re
import struct
from collections import namedtuple
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import Buffer, Frame
from arena.wire.px4_messages import FIELDS


class Field(NamedTuple):
    """Position and type of one field in the payload of a MAVLink message.

    code: type of each element as a code of the module `struct`
    offset: first byte in the payload
    elements: number of elements, 1 if the field is not an array; number of bytes of a text
    """

    code: str
    offset: int
    elements: int


def layout(msgid: int) -> dict[str, Field]:
    """Return the position of each field in a message's payload, by name and in wire order.

    Extension fields are included.

    Raises KeyError if neither the dialect nor `px4_messages.FIELDS` contains the message.
    """
    if msgid in FIELDS:
        return _layout_of(FIELDS[msgid])
    message = mavlink.mavlink_map[msgid]
    found, offset = {}, 0
    codes = re.findall(r"(\d*)([a-zA-Z])", message.unpacker.format)
    elements = [code for count, code in codes for _ in range(1 if code == "s" else int(count or 1))]
    at = 0
    for name, length in zip(message.ordered_fieldnames, message.array_lengths, strict=True):
        code = elements[at]
        found[name] = Field(code, offset, max(1, length))
        at += 1 if code == "s" else max(1, length)
        offset += max(1, length) * (1 if code == "s" else struct.calcsize(f"<{code}"))
    return found


def _layout_of(fields: str) -> dict[str, Field]:
    """Return the position of each field of a payload.

    fields: the fields in wire order, written as in `px4_messages.FIELDS`
    """
    found, offset = {}, 0
    for field in fields.split(", "):
        kind, name = field.split()
        elements = int(kind[:-1] or 1)
        found[name] = Field(kind[-1], offset, elements)
        offset += elements * struct.calcsize(f"<{kind[-1]}")
    return found


def payload_bytes(msgid: int) -> int:
    """Return the number of bytes of the complete payload of a message."""
    if msgid in FIELDS:
        last = list(layout(msgid).values())[-1]
        return last.offset + last.elements * struct.calcsize(f"<{last.code}")
    size: int = mavlink.mavlink_map[msgid].unpacker.size
    return size


_NOT_IN_DIALECT = {
    8: "LINK_NODE_STATUS",
    290: "ESC_INFO",
    291: "ESC_STATUS",
    300: "PROTOCOL_VERSION",
    380: "TIME_ESTIMATE_TO_TARGET",
    395: "COMPONENT_INFORMATION",
    397: "COMPONENT_METADATA",
    410: "EVENT",
    411: "CURRENT_EVENT_SEQUENCE",
    412: "REQUEST_EVENT",
    413: "RESPONSE_EVENT_ERROR",
    435: "AVAILABLE_MODES",
    436: "CURRENT_MODE",
    437: "AVAILABLE_MODES_MONITOR",
}
"""Messages that PX4 v1.16 sends or receives, and that pymavlink's dialect does not contain: id -> name."""


def message_name(msgid: int) -> str:
    """Return the name of a message, such as HEARTBEAT, or "message N" if it is unknown."""
    found = mavlink.mavlink_map.get(msgid)
    return str(found.msgname) if found else _NOT_IN_DIALECT.get(msgid, f"message {msgid}")


@cache
def decoder(msgid: int) -> Callable[[Buffer, Frame], Any]:
    """Return a function that decodes frames of a message to named tuples.

    The fields have pymavlink's names.

    An array is a tuple. A text is bytes, without the zeros at its end. Raises KeyError if the dialect does not contain the message.
    """
    message = mavlink.mavlink_map[msgid]
    kind = namedtuple(message.msgname, message.ordered_fieldnames)  # type: ignore[misc]
    size, unpack_from, unpack = payload_bytes(msgid), message.unpacker.unpack_from, message.unpacker.unpack
    plain = not any(field.elements > 1 or field.code == "s" for field in layout(msgid).values())

    def decode(data: Buffer, at: Frame) -> Any:
        if at.size >= size:
            values = unpack_from(data, at.payload)
        else:  # MAVLink 2 truncates zeros
            values = unpack(bytes(data[at.payload : at.payload + at.size]).ljust(size, b"\0"))
        return kind._make(values if plain else _grouped(values, message.array_lengths))

    return decode


def _grouped(values: tuple[Any, ...], lengths: list[int]) -> list[Any]:
    """Combine unpacked numbers into one value per field: the elements of an array field become a tuple."""
    found: list[Any] = []
    k = 0
    for length in lengths:
        first = values[k]
        if length and not isinstance(first, bytes):
            found.append(values[k : k + length])
            k += length
        else:
            found.append(first.rstrip(b"\0") if isinstance(first, bytes) else first)
            k += 1
    return found
