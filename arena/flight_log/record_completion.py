"""Repair of a record (flight.mcap) after its recorder was killed or restarted.

The result is one file with an index, which every MCAP reader opens.
"""

from __future__ import annotations

import fcntl
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from arena.errors import InputError
from arena.flight_log.recording import MCAP_MAGIC, later_parts, record_files
from arena.wire.flight_record import TAIL_METADATA, tail_path

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, McapRecord, Schema
    from mcap.writer import Writer


def is_complete(path: Path) -> bool:
    """Return whether a record is one file that was closed correctly.

    False if its recorder was killed or restarted. Raises InputError if the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            if file.seek(0, 2) < 2 * len(MCAP_MAGIC):
                return False
            file.seek(-len(MCAP_MAGIC), 2)
            return file.read() == MCAP_MAGIC and not later_parts(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def complete_record(path: Path) -> bool:
    """Join the parts of an incomplete record into one file with an index. Return whether the file has changed.

    A record that a recorder still writes is not changed. A message that was not written completely is lost.
    Raises InputError if a file cannot be read, OSError if it cannot be written.
    """
    parts = later_parts(path)
    if is_complete(path) or any(map(_is_being_written, (path, *parts))):
        return False
    new = path.with_name(f".{path.name}.new")
    try:
        _write(new, record_files(path))
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)
    for file in (*parts, *map(tail_path, (path, *parts))):
        file.unlink(missing_ok=True)
    return True


def _is_being_written(part: Path) -> bool:
    """Return whether a recorder is writing this file. A recorder holds a lock on its file."""
    with part.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:  # the file system has no locks
            return False
    return False


def _write(new: Path, files: tuple[Path, ...]) -> None:
    from mcap.writer import Writer

    with new.open("wb") as made:
        writer = Writer(made)
        writer.start(library="arena")
        copier = _Copier(writer)
        for file in files:
            copier.copy(file)
        writer.finish()  # type: ignore[no-untyped-call]


class _Copier:
    """Copier of the channels, messages and metadata of several MCAP files into one file.

    All channels of one topic become one channel.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._channel_of_topic: dict[str, int] = {}
        self._names: set[str] = {TAIL_METADATA}

    def copy(self, part: Path) -> None:
        from mcap.records import Channel, Message, Metadata, Schema

        schemas: dict[int, Schema] = {}
        channels: dict[int, int] = {}
        for record in _records(part):
            if isinstance(record, Message):
                number = channels.get(record.channel_id)
                if number is not None:  # else its channel was in a damaged chunk
                    self._writer.add_message(
                        number, record.log_time, record.data, record.publish_time, record.sequence
                    )
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = self._channel(record, schemas.get(record.schema_id))
            elif isinstance(record, Metadata) and record.name not in self._names:  # each part repeats it
                self._names.add(record.name)
                self._writer.add_metadata(record.name, record.metadata)

    def _channel(self, channel: Channel, schema: Schema | None) -> int:
        """Return the id that a channel has in the new file. A new topic is registered first."""
        if channel.topic not in self._channel_of_topic:
            writer = self._writer
            number = (
                0 if schema is None else writer.register_schema(schema.name, schema.encoding, schema.data)
            )
            self._channel_of_topic[channel.topic] = writer.register_channel(
                channel.topic, channel.message_encoding, number, channel.metadata
            )
        return self._channel_of_topic[channel.topic]


def _records(path: Path) -> Iterator[McapRecord]:
    """Yield the records of an MCAP file up to the end, or up to the first incomplete record. Damaged chunks are left out."""
    from mcap.exceptions import McapError
    from mcap.records import Chunk, DataEnd
    from mcap.stream_reader import StreamReader

    try:
        with path.open("rb") as file:
            for record in StreamReader(file, emit_chunks=True, record_size_limit=1 << 30).records:
                if isinstance(record, DataEnd):
                    return
                yield from _of_chunk(record) if isinstance(record, Chunk) else (record,)
    except (McapError, RuntimeError, ValueError, struct.error):
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _of_chunk(chunk: Chunk) -> list[McapRecord]:
    """Return the records in a chunk, or an empty list if the chunk is damaged."""
    from mcap.exceptions import McapError
    from mcap.stream_reader import breakup_chunk
    from zstandard import ZstdError

    try:
        return breakup_chunk(chunk, validate_crc=True)
    except (McapError, ZstdError, RuntimeError, ValueError, struct.error):
        return []
