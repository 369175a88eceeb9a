"""Writer of the file `flight.mcap`. A thread compresses and writes, so a full or slow disk ends the record but not the flight.

The index of an MCAP file has an entry per chunk and channel, and the writer keeps the index in memory until the end. So the chunks are
long (`FLUSHES_PER_CHUNK`). The messages of the unfinished chunk are also in a second file, `flight.mcap.tail`, which gets a small chunk
without an index at each flush, and begins again after each chunk of the record. Readers use it only if a recorder was killed.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from arena.background_writer import BackgroundWriter, write_all
from arena.kernels.mcap_messages import MessageBuffer, MessageChannel
from arena.recorder.mcap_records import (
    Definitions,
    IndexedFile,
    SchemaData,
    file_head,
    metadata_record,
    plain_chunk,
)
from arena.wire.flight_record import TAIL_METADATA, TAIL_START, tail_path

FLUSHES_PER_CHUNK = 20
"""Number of calls of `McapFile.flush` after which a chunk of the record ends."""
MAX_CHUNK_BYTES = 4 << 20
"""A chunk ends earlier if its messages have more bytes, because readers unpack a whole chunk at a time."""
MAX_WAITING_BYTES = 64 << 20
"""The record ends if more bytes wait for the disk."""
CLOSE_TIMEOUT_S = 5.0
_NO_LIMIT = 1 << 30


Log = Callable[[bytes, int], None]
"""Function that sends an encoded message. Its second argument is the log time [ns]."""
MakeChannel = Callable[[str, str, SchemaData], Log]
"""Function that creates a channel: topic, encoding of its messages, schema."""
_Piece = tuple[bytes, int, int]  # as from `MessageBuffer.take`


class McapFile:
    """Writer of the file flight.mcap. It stores the messages of all channels that were created with `channel`.

    Messages are collected in memory. `flush` writes them, in a thread that also waits until they are on the disk. If power is
    lost, the record loses only the messages since the last `flush` (and the time that the disk needs). The file is locked while
    it is written (`arena.flight_log.record_completion`).

    path: path of the file. If it exists, the recorder was restarted, and the next free path of `part_paths` is used.
    metadata: content of the metadata record `name`.
    max_waiting_bytes: the record ends if more bytes wait for the disk.
    failure: why the record has ended, "" while it is written.
    Raises OSError if the file cannot be created.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        metadata: Mapping[str, str],
        *,
        max_waiting_bytes: int = MAX_WAITING_BYTES,
    ) -> None:
        self.failure = ""
        self.path, self._fd = _create(path)
        with contextlib.suppress(OSError):  # not every file system has locks
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._tail_path = tail_path(self.path)
        self._tail_fd = os.open(self._tail_path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        self._limit, self._submitted, self._written = max_waiting_bytes, 0, 0
        self._thread = BackgroundWriter("record", _NO_LIMIT)
        self._definitions = Definitions()
        self._buffer = MessageBuffer(self._definitions.define)
        self._channels: list[MessageChannel] = []
        self._indexed = IndexedFile(self._definitions)  # only the thread uses it after this function
        self._flushes = self._chunk_bytes = 0
        self._chunk: list[_Piece] = []
        self._before_tail = b""  # definitions in earlier chunks, which the new tail needs, too
        head = self._indexed.begin(name, metadata)
        self._submit(len(head), partial(self._write_record, head))

    @property
    def busy(self) -> bool:
        """True while data wait to be written to the disk."""
        return self._thread.busy

    def channel(self, topic: str, encoding: str, schema: SchemaData) -> Log:
        """Create a channel, and return the function that sends its messages. encoding: how the messages are encoded.

        The file contains the channel only if a message is sent.
        """
        channel = MessageChannel(self._buffer, self._definitions.add(topic, encoding, schema))
        self._channels.append(channel)
        return channel.log

    def flush(self) -> None:
        """Write all new messages to the file, in a background thread. Never blocks."""
        if self.failure:
            self._buffer.stop()
            return
        piece = self._take()
        self._flushes += 1
        self._chunk_bytes += len(piece[0])
        if self._flushes >= FLUSHES_PER_CHUNK or self._chunk_bytes >= MAX_CHUNK_BYTES:
            self._finish_chunk()
        elif piece[0]:
            records = self._before_tail + piece[0]
            self._before_tail = b""
            self._submit(len(records), partial(self._write_tail, (records, *piece[1:])))

    def close(self, timeout_s: float = CLOSE_TIMEOUT_S) -> bool:
        """Write the remaining messages and the index, and wait until they are on the disk.

        timeout_s: longest time to wait [s].

        Return whether everything was written.
        """
        self._take()
        self._finish_chunk()
        self._buffer.stop()
        self._submit(0, self._write_end)
        if not self._thread.flush(timeout_s):
            self.failure = self.failure or f"the disk has not responded for {timeout_s:g} s"
            return False
        os.close(self._fd)
        os.close(self._tail_fd)
        return not self.failure

    def _take(self) -> _Piece:
        """Move the new messages from the buffer to the present chunk, and return them."""
        piece = self._buffer.take()
        if piece[0]:
            self._chunk.append(piece)
        return piece

    def _finish_chunk(self) -> None:
        """Write the current chunk in the background. `flight.mcap.tail` then begins again, with the messages after this chunk."""
        pieces, self._chunk = self._chunk, []
        self._flushes = self._chunk_bytes = 0
        self._before_tail = b"".join(self._definitions.schemas + self._definitions.channels)
        if pieces:
            self._submit(sum(len(piece[0]) for piece in pieces), partial(self._write_chunk, pieces))

    def _submit(self, size: int, write: Callable[[], None]) -> None:
        """Call `write` in the background thread. The record ends if too many bytes wait for this thread.

        size: number of bytes that `write` writes, before their compression.
        """
        if self.failure:
            return
        waiting = self._submitted - self._written
        if waiting + size > self._limit:
            self.failure = f"the disk does not respond: {waiting / 1e6:.0f} MB wait to be written"
            return
        self._submitted += size
        self._thread.submit(partial(self._in_background, size, write))

    def _in_background(self, size: int, write: Callable[[], None]) -> None:
        """Call `write` in the background thread; after the first error, do nothing. size: as for `_submit`."""
        try:
            if not self.failure:
                write()
        except OSError as error:
            self.failure = error.strerror or str(error)
        except Exception as error:
            self.failure = f"error of the MCAP writer: {error!r}"
        finally:
            self._written += size

    def _write_tail(self, piece: _Piece) -> None:
        _write(self._tail_fd, plain_chunk(*piece))

    def _write_chunk(self, pieces: list[_Piece]) -> None:
        records = b"".join(piece[0] for piece in pieces)
        first, last = min(piece[1] for piece in pieces), max(piece[2] for piece in pieces)
        self._write_record(self._indexed.chunk(records, first, last))

    def _write_record(self, data: bytes) -> None:
        """Write to flight.mcap, and begin the tail again: only now, because its messages are on the disk."""
        _write(self._fd, data)
        os.ftruncate(self._tail_fd, 0)
        os.lseek(self._tail_fd, 0, os.SEEK_SET)
        write_all(
            self._tail_fd, file_head() + metadata_record(TAIL_METADATA, {TAIL_START: str(self._indexed.size)})
        )

    def _write_end(self) -> None:
        _write(self._fd, self._indexed.end(self._channels))
        self._tail_path.unlink(missing_ok=True)


def _write(fd: int, data: bytes) -> None:
    """Write bytes to the disk, and wait until they are stored there. Raises OSError."""
    write_all(fd, data)
    os.fdatasync(fd)


def _create(path: Path) -> tuple[Path, int]:
    """Create the MCAP file and return its path and file descriptor.

    If the file exists already, create the next part of the record.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part, number = path, 2
    while True:
        try:
            return part, os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except FileExistsError:
            part, number = path.with_suffix(f".{number}{path.suffix}"), number + 1
