"""Reader of the parameters in a PX4 log file (ULog), see https://docs.px4.io/main/en/dev_log/ulog_file_format.

    header: 55 4C 6F 67 01 12 35, version (1 byte), time stamp (8 bytes)
    then messages: <H B  size, type, and `size` bytes
      'B' flag bits   8 bytes compatible, 8 incompatible (the first bit: data is appended), 3 offsets of 8 bytes
      'I' information, 'P' parameter: length of the key (1 byte), key `type name`, value
      'A', 'L' or 'C': the first of them ends the definitions; a 'P' after it is a parameter that was changed
      'S' synchronisation, to find a message again after damaged ones

A parameter is an int32_t or a float. Most logs end in the middle of their data, which is accepted. A log that
ends or is damaged within its definitions is refused, because parameters are missing.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from typing import Literal

from arena.errors import WireError

MAGIC = b"ULog\x01\x12\x35"
_ENDS = b"ALC"
_KNOWN = b"BFIMPQADRSOLC"
_SYNC = bytes.fromhex("2F731320250CBB12")
_HEAD = struct.Struct("<HB")
_FLAGS = struct.Struct("<8s8s3Q")
_START = 16
_NUMBERS = {"int32_t": struct.Struct("<i"), "uint32_t": struct.Struct("<I"), "float": struct.Struct("<f")}
_NAME = re.compile(r"[A-Za-z0-9_]{1,16}")


@dataclass
class Log:
    """Parameters and information messages (such as the PX4 version) that were read from a log.

    initial: name -> value at the start of the log
    changed: name -> last value that was set after the start
    types: name -> "INT32" or "FLOAT"
    info: information messages that are text or a number
    damaged: positions [byte] at which an unreadable part begins
    """

    initial: dict[str, float] = field(default_factory=dict)
    changed: dict[str, float] = field(default_factory=dict)
    types: dict[str, Literal["INT32", "FLOAT"]] = field(default_factory=dict)
    info: dict[str, str | float] = field(default_factory=dict)
    damaged: list[int] = field(default_factory=list)


def parse_ulog(data: bytes) -> Log:
    """Read the parameters and information messages of a ULog file.

    Raises WireError, with the byte position, if it is not a ULog or its definitions are incomplete.
    """
    if not data.startswith(MAGIC) or len(data) < _START:
        raise WireError(
            f"byte 0: got {data[:7].hex(' ').upper()} in a file of {len(data)} bytes,"
            f" expected a ULog header of {_START} bytes that begins with 55 4C 6F 67 01 12 35"
        )
    return _Reader(data).read()


class _Reader:
    def __init__(self, data: bytes) -> None:
        self.data, self.log, self.at = data, Log(), _START
        self.defining = True
        self.appended: list[int] = []

    def read(self) -> Log:
        while self.at < len(self.data):
            whole = self._next()
            if whole is None and self.defining:
                raise WireError(
                    f"byte {self.at}: the log ends before its definitions section is complete; some parameters are missing"
                )
            if whole is None:
                break
            kind, body = whole
            place, self.at = self.at, self.at + _HEAD.size + len(body)
            if kind in _KNOWN and body:
                self._take(kind, body, place)
            elif self.defining:
                raise WireError(
                    f"byte {place}: got a message of type {chr(kind)!r} and {len(body)} bytes in the definitions section,"
                    f" expected 1 byte or more and one of the types {', '.join(_KNOWN.decode())}: is the file damaged?"
                )
            elif not self._recover(place):
                break
        return self.log

    def _next(self) -> tuple[int, bytes] | None:
        """Return the next message of the log, or None if the log ends before the message is complete."""
        if len(self.data) - self.at < _HEAD.size:
            return None
        size, kind = _HEAD.unpack_from(self.data, self.at)
        end = self.at + _HEAD.size + size
        # data appended later begins where the last message was cut off
        if self.appended and end > self.appended[0]:
            self.at = self.appended.pop(0)
            return self._next()
        return (kind, self.data[self.at + _HEAD.size : end]) if end <= len(self.data) else None

    def _take(self, kind: int, body: bytes, place: int) -> None:
        if kind in _ENDS:
            self.defining = False
        elif kind == ord("B") and place == _START:
            self._flags(body)
        elif kind in b"IP":
            try:
                self._keyed(kind, body)
            except (ValueError, struct.error) as error:
                if self.defining:
                    raise WireError(f"byte {place}: {error}") from None
                self.log.damaged.append(place)

    def _flags(self, body: bytes) -> None:
        if len(body) < _FLAGS.size:
            raise WireError(
                f"byte {_START}: got a flag bits message of {len(body)} bytes, expected at least {_FLAGS.size}"
            )
        _, incompatible, *offsets = _FLAGS.unpack_from(body)
        if incompatible[0] & ~1 or any(incompatible[1:]):
            raise WireError(
                f"byte {_START}: this version of ULog is too new to be read (incompatible flags {incompatible.hex()})"
            )
        self.appended = sorted(o for o in offsets if _START < o <= len(self.data))

    def _keyed(self, kind: int, body: bytes) -> None:
        end = 1 + body[0]
        form, _, name = body[1:end].decode("ascii", "replace").partition(" ")
        value: str | float
        if form.startswith("char["):
            value = body[end:].decode("utf-8", "replace")
        elif form in _NUMBERS:
            if len(body) - end != 4:
                raise ValueError(f"the value of {name!r} has {len(body) - end} bytes, expected 4")
            (value,) = _NUMBERS[form].unpack_from(body, end)
        elif kind == ord("I"):
            return
        else:
            raise ValueError(f"got a parameter {name!r} of type {form!r}, expected int32_t or float")
        if kind == ord("I"):
            self.log.info[name] = value
        else:
            self._parameter(form, name, value)

    def _parameter(self, form: str, name: str, value: str | float) -> None:
        if isinstance(value, str) or form == "uint32_t":
            raise ValueError(f"got a parameter {name!r} of type {form!r}, expected int32_t or float")
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not a parameter name (1 to 16 letters, digits and _)")
        (self.log.initial if self.defining else self.log.changed)[name] = value
        self.log.types[name] = "FLOAT" if form == "float" else "INT32"

    def _recover(self, place: int) -> bool:
        """Skip a damaged part of the log. Return False if the log has no further synchronisation message."""
        self.log.damaged.append(place)
        found = self.data.find(_SYNC, place)
        self.at = found + len(_SYNC)
        return found >= 0
