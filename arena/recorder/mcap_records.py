"""Bytes of an MCAP file: its records, except the messages, which `arena.kernels.mcap_messages` packs. Pure.

The format is described at https://mcap.dev/spec. Tests read the files with the package `mcap`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Protocol

import zstandard
from fastcrc import crc32

from arena.kernels.mcap_messages import MessageChannel, message_index

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = 1, 2, 3, 4, 6, 7, 8
_STATISTICS, _METADATA, _METADATA_INDEX, _SUMMARY_OFFSET, _DATA_END = 11, 12, 13, 14, 15
_HEAD, _ENTRY = struct.Struct("<BQ"), struct.Struct("<HQ")
_TWO, _FOUR, _EIGHT = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")
_COMPRESSION, _COMPRESSION_LEVEL = "zstd", 1
_LIBRARY = "arena"


class SchemaData(Protocol):
    """Attributes of a schema, which is from `arena.wire.flight_record` or from foxglove-sdk."""

    @property
    def name(self) -> str: ...
    @property
    def encoding(self) -> str: ...
    @property
    def data(self) -> bytes: ...


class Definitions:
    """Definitions of the channels of an MCAP file and of their schemas.

    Numbers of channels and schemas begin with 1.

    schemas, channels: records of those that are in the file.
    """

    def __init__(self) -> None:
        self.schemas: list[bytes] = []
        self.channels: list[bytes] = []
        self._known: list[tuple[bytes, bytes]] = []
        self._numbers: dict[tuple[str, str, bytes], int] = {}

    def __len__(self) -> int:
        """Return the number of channels. Channels without a message count, too."""
        return len(self._known)

    def add(self, topic: str, encoding: str, schema: SchemaData) -> int:
        """Add a channel and return its number. encoding: how its messages are encoded."""
        key = schema.name, schema.encoding, schema.data
        schema_number = self._numbers.setdefault(key, 1 + len(self._numbers))
        number = 1 + len(self._known)
        described = _TWO.pack(schema_number) + _text(schema.name) + _text(schema.encoding)
        channel = struct.pack("<HH", number, schema_number) + _text(topic) + _text(encoding) + _sized(b"")
        self._known.append((record(_SCHEMA, described + _sized(schema.data)), record(_CHANNEL, channel)))
        return number

    def define(self, number: int) -> bytes:
        """Return the records that define a channel. In the file they must precede its first message. Call this once per channel."""
        schema, channel = self._known[number - 1]
        is_new = schema not in self.schemas
        self.schemas += [schema] * is_new
        self.channels.append(channel)
        return schema * is_new + channel


class IndexedFile:
    """Bytes of an MCAP file with compressed chunks and an index. Append the results of the calls to the file.

    definitions: of its channels.
    size: number of bytes so far.
    """

    def __init__(self, definitions: Definitions) -> None:
        self._definitions, self.size, self._crc = definitions, 0, 0
        self._first, self._last = 0, 0
        self._chunks: list[bytes] = []
        self._metadata = b""

    def begin(self, name: str, metadata: Mapping[str, str]) -> bytes:
        """Return the begin of the file, which contains a metadata record."""
        head, content = file_head(), metadata_record(name, metadata)
        place = struct.pack("<QQ", len(head), len(content))
        self._metadata = record(_METADATA_INDEX, place + _text(name))
        return self._append(head + content)

    def chunk(self, records: bytes, first: int, last: int) -> bytes:
        """Return a chunk with its index.

        records: definitions and messages.  first, last: first and last log time in them [ns].
        """
        compressed = zstandard.ZstdCompressor(level=_COMPRESSION_LEVEL).compress(records)
        chunk = _chunk(records, compressed, _COMPRESSION, first, last)
        begin, at, places, indexes = self.size, self.size + len(chunk), [], []
        for number, entries in enumerate(message_index(records, len(self._definitions)), start=1):
            if entries:
                places.append(_ENTRY.pack(number, at))
                indexes.append(record(_MESSAGE_INDEX, _TWO.pack(number) + _sized(entries)))
                at += len(indexes[-1])
        self._first = min(self._first, first) if self._chunks else first
        self._last = max(self._last, last)
        self._chunks.append(
            record(
                _CHUNK_INDEX,
                struct.pack("<4Q", first, last, begin, len(chunk))
                + _sized(b"".join(places))
                + _EIGHT.pack(at - begin - len(chunk))
                + _text(_COMPRESSION)
                + struct.pack("<QQ", len(compressed), len(records)),
            )
        )
        return self._append(b"".join((chunk, *indexes)))

    def end(self, channels: Sequence[MessageChannel]) -> bytes:
        """Return the end of the file. channels: all channels, with the numbers of their messages."""
        data_end = record(_DATA_END, _FOUR.pack(self._crc))
        groups = (
            (_SCHEMA, self._definitions.schemas),
            (_CHANNEL, self._definitions.channels),
            (_STATISTICS, [self._statistics(channels)]),
            (_CHUNK_INDEX, self._chunks),
            (_METADATA_INDEX, [self._metadata]),
        )
        start = at = self.size + len(data_end)
        summary, offsets = [], []
        for code, group in groups:
            size = sum(map(len, group))
            if size:
                summary += group
                offsets.append(record(_SUMMARY_OFFSET, struct.pack("<BQQ", code, at, size)))
                at += size
        footer = struct.pack("<QQ", start, at)
        checked = b"".join((*summary, *offsets, _HEAD.pack(_FOOTER, len(footer) + _FOUR.size), footer))
        return data_end + checked + _FOUR.pack(zlib.crc32(checked)) + MAGIC

    def _statistics(self, channels: Sequence[MessageChannel]) -> bytes:
        counts = [(channel.number, channel.count) for channel in channels if channel.count]
        numbers = len(self._definitions.schemas), len(counts), 0, 1, len(self._chunks)
        head = struct.pack("<QHIIII", sum(count for _, count in counts), *numbers)
        times = struct.pack("<QQ", self._first, self._last)
        return record(_STATISTICS, head + times + _sized(b"".join(_ENTRY.pack(*entry) for entry in counts)))

    def _append(self, data: bytes) -> bytes:
        self.size += len(data)
        self._crc = zlib.crc32(data, self._crc)
        return data


def file_head() -> bytes:
    """Return the begin of an MCAP file: the magic bytes and the header record."""
    return MAGIC + record(_HEADER, _text("") + _text(_LIBRARY))


def metadata_record(name: str, metadata: Mapping[str, str]) -> bytes:
    """Return a record with texts about the file. name: of the record.  metadata: key -> text."""
    content = b"".join(_text(key) + _text(value) for key, value in metadata.items())
    return record(_METADATA, _text(name) + _sized(content))


def plain_chunk(records: bytes, first: int, last: int) -> bytes:
    """Return a chunk that is not compressed and has no index. The arguments are those of `IndexedFile.chunk`."""
    return _chunk(records, records, "", first, last)


def record(code: int, content: bytes) -> bytes:
    """Return a record. code: MCAP's opcode."""
    return _HEAD.pack(code, len(content)) + content


def _chunk(records: bytes, stored: bytes, compression: str, first: int, last: int) -> bytes:
    head = struct.pack("<QQQI", first, last, len(records), crc32.iso_hdlc(records))
    head += _text(compression) + _EIGHT.pack(len(stored))
    return b"".join((_HEAD.pack(_CHUNK, len(head) + len(stored)), head, stored))


def _text(text: str) -> bytes:
    return _sized(text.encode())


def _sized(data: bytes) -> bytes:
    return _FOUR.pack(len(data)) + data
