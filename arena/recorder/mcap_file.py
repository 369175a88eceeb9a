"""Writer of the file `flight.mcap`. A thread writes, so a full or slow disk ends the record but not the flight.

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
from typing import TYPE_CHECKING

from arena.background_writer import BackgroundWriter, write_all
from arena.wire.flight_record import TAIL_METADATA, TAIL_START, tail_path

if TYPE_CHECKING:
    from foxglove import Context

FLUSHES_PER_CHUNK = 20
"""Number of calls of `McapFile.flush` after which a chunk of the record ends."""
MAX_CHUNK_BYTES = 4 << 20
"""A chunk ends earlier if its messages have more bytes, because readers unpack a whole chunk at a time."""
MAX_WAITING_BYTES = 64 << 20
"""The record ends if more bytes wait for the disk."""
CLOSE_TIMEOUT_S = 5.0
_NO_LIMIT = 1 << 30


class McapFile:
    """Writer of the file flight.mcap, which stores all messages of one foxglove-sdk `Context`.

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
        context: Context,
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
        self._context = context
        self._record = _Writer(context, indexed=True)
        self._record.write_metadata(name, metadata)
        self._record_bytes = self._flushes = self._chunk_bytes = 0
        self._tail = self._finish_chunk()

    @property
    def busy(self) -> bool:
        """True while data wait to be written to the disk."""
        return self._thread.busy

    def flush(self) -> None:
        """Write all new messages to the file, in a background thread. Never blocks."""
        if self.failure:
            self._stop()
            return
        data = self._bytes_of(self._tail.flush)
        self._flushes += 1
        self._chunk_bytes += len(data)
        if self._flushes < FLUSHES_PER_CHUNK and self._chunk_bytes < MAX_CHUNK_BYTES:
            self._submit(data, self._write_tail)
            return
        self._stop_tail()
        self._tail = self._finish_chunk()

    def close(self, timeout_s: float = CLOSE_TIMEOUT_S) -> bool:
        """Write the remaining messages and the index, and wait until they are on the disk.

        timeout_s: longest time to wait [s].

        Return whether everything was written.
        """
        self._stop_tail()
        data = self._bytes_of(self._record.close)
        if not self.failure:
            self._submit(data, self._write_end)
        if not self._thread.flush(timeout_s):
            self.failure = self.failure or f"the disk has not responded for {timeout_s:g} s"
            return False
        os.close(self._fd)
        os.close(self._tail_fd)
        return not self.failure

    def _finish_chunk(self) -> _Writer:
        """Finish the current chunk of `flight.mcap` and write it in the background.

        Return a writer for `flight.mcap.tail`, which begins again: the file gets only the messages after this chunk.
        """
        data = self._bytes_of(self._record.flush)
        self._record_bytes += len(data)
        self._flushes = self._chunk_bytes = 0
        self._submit(data, self._write_chunk)
        tail = _Writer(self._context, indexed=False)
        tail.write_metadata(TAIL_METADATA, {TAIL_START: str(self._record_bytes)})
        return tail

    def _stop(self) -> None:
        """Close both MCAP writers (record and tail file) after a failure, so that no more messages collect in memory."""
        self._stop_tail()
        self._bytes_of(self._record.close)

    def _stop_tail(self) -> None:
        self._bytes_of(self._tail.close)

    def _bytes_of(self, write: Callable[[], bytes]) -> bytes:
        """Return the bytes that a writer has produced. If the writer raises an error, stop the record and return no bytes."""
        try:
            return write()
        except Exception as error:
            self.failure = self.failure or f"error of the MCAP writer: {error!r}"
            return b""

    def _submit(self, data: bytes, write: Callable[[bytes], None]) -> None:
        if not data or self.failure:
            return
        waiting = self._submitted - self._written
        if waiting + len(data) > self._limit:
            self.failure = f"the disk does not respond: {waiting / 1e6:.0f} MB wait to be written"
            return
        self._submitted += len(data)
        self._thread.submit(partial(self._in_background, data, write))

    def _in_background(self, data: bytes, write: Callable[[bytes], None]) -> None:
        """Write bytes to the disk in the background thread. Write nothing after the first error."""
        try:
            if not self.failure:
                write(data)
        except OSError as error:
            self.failure = error.strerror or str(error)
        finally:
            self._written += len(data)

    def _write_tail(self, data: bytes) -> None:
        _write(self._tail_fd, data)

    def _write_chunk(self, data: bytes) -> None:
        _write(self._fd, data)
        os.ftruncate(self._tail_fd, 0)  # only now, because the chunk with its messages is on the disk
        os.lseek(self._tail_fd, 0, os.SEEK_SET)

    def _write_end(self, data: bytes) -> None:
        _write(self._fd, data)
        self._tail_path.unlink(missing_ok=True)


class _Writer:
    """MCAP writer that writes into memory.

    context: foxglove's context.
    indexed: compress the chunks, and keep their index in memory.
    """

    def __init__(self, context: Context, *, indexed: bool) -> None:
        from foxglove import open_mcap
        from foxglove.mcap import MCAPCompression, MCAPWriteOptions

        self._buffer = _Buffer()
        self._is_open = True
        options = MCAPWriteOptions(
            compression=MCAPCompression.Zstd if indexed else None,
            compression_level=1,
            compression_threads=0,
            chunk_size=None,
            emit_message_indexes=indexed,
            emit_chunk_indexes=indexed,
            disable_seeking=True,
        )
        self._writer = open_mcap(self._buffer, context=context, writer_options=options)  # type: ignore[arg-type]

    def write_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        self._writer.write_metadata(name, dict(metadata))

    def flush(self) -> bytes:
        """End the current MCAP chunk. Return the bytes of the file that were produced since the last call."""
        self._writer.flush()
        return self._buffer.take()

    def close(self) -> bytes:
        """Write the last chunk and the end of the file. Return the new bytes; no bytes if the file is already closed."""
        if self._is_open:
            self._is_open = False
            self._writer.close()
        return self._buffer.take()


class _Buffer:
    """File-like object in memory that the MCAP writer of foxglove-sdk appends to.

    Collects the bytes until `take` is called. It supports no seeking (`disable_seeking`).
    """

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._size = 0

    def write(self, data: bytes) -> int:
        self._pieces.append(data)
        self._size += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._size

    def flush(self) -> None:
        """Do nothing. `McapFile.flush` writes the bytes to the disk."""

    def take(self) -> bytes:
        """Return the bytes that were written since the last call, and remove them from memory."""
        found = b"".join(self._pieces)
        self._pieces.clear()
        return found


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
