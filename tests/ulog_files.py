"""A small writer of PX4 logs (ULog), for tests: https://docs.px4.io/main/en/dev_log/ulog_file_format."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from pathlib import Path

_CODES = {"uint64_t": "Q", "float": "f", "uint8_t": "B", "bool": "?"}


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def write_ulog(
    path: Path, topics: Mapping[str, tuple[Mapping[str, str], Iterable[tuple[float, ...]]]]
) -> Path:
    """Write a log. topics: name -> (field -> type, rows); the first field is `timestamp` [us]. A type can be `float[3]`."""
    definitions, data = b"", b""
    for number, (name, (fields, rows)) in enumerate(topics.items()):
        text = ";".join(f"{kind} {field}" for field, kind in fields.items())
        definitions += _message("F", f"{name}:{text};".encode())
        data += _message("A", struct.pack("<BH", 0, number) + name.encode())
        code = "<" + "".join(_struct_code(kind) for kind in fields.values())
        for row in rows:
            data += _message("D", struct.pack("<H", number) + struct.pack(code, *row))
    flags = _message("B", bytes(40))
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8) + flags + definitions + data)
    return path


def _struct_code(kind: str) -> str:
    name, _, count = kind.partition("[")
    return count.rstrip("]") + _CODES[name]
