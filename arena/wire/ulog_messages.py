"""Encoder of messages in PX4's log format ULog, see https://docs.px4.io/main/en/dev_log/ulog_file_format. Pure.

    message: <H B  size, type, and `size` bytes
    definitions: header, 'B' flag bits, 'F' formats, 'I' information, 'P' parameters, 'Q' default values of parameters
    data: 'A' subscriptions, 'D' records, 'L' texts, 'P' changed parameters, 'O' gaps

`arena.wire.ulog` reads them.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping

import numpy as np

from arena.wire.ulog import MAGIC

_HEAD = struct.Struct("<HB")
_VERSION = 1
_HAS_DEFAULTS = 1  # compatible flag: the log contains default values of parameters
_SYSTEM_DEFAULT, _SETUP_DEFAULT = 1, 2
_CODES = {
    "uint64_t": "<u8",
    "int64_t": "<i8",
    "double": "<f8",
    "uint32_t": "<u4",
    "int32_t": "<i4",
    "float": "<f4",
    "uint16_t": "<u2",
    "int16_t": "<i2",
    "uint8_t": "u1",
    "int8_t": "i1",
    "bool": "u1",
    "char": "S1",
}
_MOST_GAP_MS = 65535
RECORD_HEAD = (("size", "<u2"), ("kind", "u1"), ("msg_id", "<u2"))
"""First fields of every record ('D')."""
TEXT_BYTES = 127
"""Longest text that PX4 logs."""


def message(kind: str, body: bytes) -> bytes:
    """Return the bytes of one ULog message.

    kind: its type, one letter
    """
    return _HEAD.pack(len(body), ord(kind)) + body


def file_header(time_us: int) -> bytes:
    """Return the beginning of a ULog file: the file header and the flag bits message.

    time_us: time since boot at the start of the log [us]
    """
    flags = bytes((_HAS_DEFAULTS, *[0] * 7)) + bytes(8 + 3 * 8)
    return MAGIC + struct.pack("<BQ", _VERSION, time_us) + message("B", flags)


def information(values: Mapping[str, str | int]) -> bytes:
    """Return ULog information messages ('I') with texts, and with integers as uint32_t."""
    found = []
    for name, value in values.items():
        raw = value.encode() if isinstance(value, str) else struct.pack("<I", value)
        kind = f"char[{len(raw)}]" if isinstance(value, str) else "uint32_t"
        found.append(message("I", _key(f"{kind} {name}") + raw))
    return b"".join(found)


def topic_format(topic: str, fields: str) -> bytes:
    """Return the format message ('F') of a logged topic, which lists the topic's fields.

    fields: fields as `type name;`, to which padding is added, as PX4 does
    """
    padding = -(record_type(fields).itemsize - _record_head().itemsize) % 8
    text = f"{topic}:{fields}" + (f"uint8_t[{padding}] _padding0;" if padding else "")
    return message("F", text.encode())


def record_type(fields: str) -> np.dtype[np.void]:
    """Return the numpy type of a logged topic's data messages ('D'): `RECORD_HEAD`, then the fields.

    A record contains no padding, so its fields are not aligned.
    fields: fields as `type name;`
    """
    found: list[tuple[str, str] | tuple[str, str, tuple[int]]] = list(RECORD_HEAD)
    for text in fields.rstrip(";").split(";"):
        kind, name = text.split(" ")
        kind, _, count = kind.rstrip("]").partition("[")
        found.append((name, _CODES[kind], (int(count),)) if count else (name, _CODES[kind]))
    return np.dtype(found)


def set_record_head(records: np.ndarray[tuple[int], np.dtype[np.void]], number: int) -> None:
    """Fill the header fields (`RECORD_HEAD`) of all data messages of a logged topic.

    number: msg_id of the topic
    """
    records["size"] = records.dtype.itemsize - _HEAD.size
    records["kind"] = ord("D")
    records["msg_id"] = number


def subscriptions(topics: Iterable[str]) -> bytes:
    """Return the subscription messages ('A'), which number the logged topics. The first topic has msg_id 0."""
    return b"".join(
        message("A", struct.pack("<BH", 0, number) + topic.encode()) for number, topic in enumerate(topics)
    )


class ParameterMessages:
    """Encoder of the parameters in a log and of their defaults.

    types: name -> "int32" or "float".
    defaults: name -> default value
    """

    def __init__(self, types: Mapping[str, str], defaults: Mapping[str, float]) -> None:
        self._defaults = defaults
        self._known: dict[str, tuple[struct.Struct, bytes, bytes]] = {}
        for name, kind in types.items():
            code, key = ("<i", f"int32_t {name}") if kind == "int32" else ("<f", f"float {name}")
            value = _HEAD.pack(len(key) + 5, ord("P")) + _key(key)
            both = _SYSTEM_DEFAULT | _SETUP_DEFAULT
            default = _HEAD.pack(len(key) + 6, ord("Q")) + bytes((both,)) + _key(key)
            self._known[name] = struct.Struct(code), value, default

    def value(self, name: str, value: float) -> bytes:
        """Return the parameter message ('P') with the value of one parameter."""
        code, head, _ = self._known[name]
        return head + _packed(code, value)

    def all(self, values: Mapping[str, float]) -> bytes:
        """Return the messages with all parameters of a log, and with the defaults of the changed parameters."""
        found = [self.value(name, value) for name, value in values.items()]
        for name, value in values.items():
            code, _, head = self._known[name]
            if (default := _packed(code, self._defaults[name])) != _packed(code, value):
                found.append(head + default)
        return b"".join(found)


def text(severity: int, time_us: int, words: str) -> bytes:
    """Return the ULog message ('L') with a text, its severity and its time.

    severity: MAV_SEVERITY.
    time_us: time since boot [us]
    """
    raw = words.encode(errors="replace")[:TEXT_BYTES].decode(errors="ignore").encode()
    return message("L", struct.pack("<BQ", ord("0") + severity, time_us) + raw)


def gap(duration_s: float) -> bytes:
    """Return the dropout message ('O'), which reports for how long the log has no data [s], at most 65.5 s."""
    return message("O", struct.pack("<H", min(round(1e3 * duration_s), _MOST_GAP_MS)))


def _record_head() -> np.dtype[np.void]:
    return np.dtype(list(RECORD_HEAD))


def _key(words: str) -> bytes:
    return bytes((len(words),)) + words.encode()


def _packed(code: struct.Struct, value: float) -> bytes:
    return code.pack(int(value) if code.format.endswith("i") else value)
