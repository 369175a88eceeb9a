"""ULogs as bytes, made for tests: definitions with parameters, then data."""

from __future__ import annotations

import struct

HEADER = bytes.fromhex("554C6F67011235") + b"\x01" + struct.pack("<Q", 12_000)
SYNC = struct.pack("<HB", 8, ord("S")) + bytes.fromhex("2F731320250CBB12")
DATA = struct.pack("<HB", 10, ord("D")) + bytes(10)
VERSION_1_16_0 = 0x01_10_00_FF


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def keyed(kind: str, key: str, value: bytes) -> bytes:
    return message(kind, bytes([len(key)]) + key.encode() + value)


def parameter(name: str, value: float) -> bytes:
    if isinstance(value, int):
        return keyed("P", f"int32_t {name}", struct.pack("<i", value))
    return keyed("P", f"float {name}", struct.pack("<f", value))


def flags(*, incompatible: int = 0, appended: int = 0) -> bytes:
    return message("B", bytes(8) + bytes([incompatible]) + bytes(7) + struct.pack("<3Q", appended, 0, 0))


def logged() -> bytes:
    """The first message of the data."""
    return message("A", b"\0" + struct.pack("<H", 0) + b"thing")


def definitions(**values: float) -> bytes:
    """Up to the end of the definitions."""
    release = keyed("I", "uint32_t ver_sw_release", struct.pack("<I", VERSION_1_16_0))
    hardware = keyed("I", "char[7] ver_hw", b"PX4_FMU")
    form = message("F", b"thing:uint64_t timestamp;")
    return HEADER + flags() + release + hardware + form + b"".join(parameter(n, v) for n, v in values.items())


def ulog(**values: float) -> bytes:
    return definitions(**values) + logged() + SYNC + DATA
