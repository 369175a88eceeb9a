"""Log files `ulog/<vehicle>.ulg` in the run folder, which a thread writes in the background."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

from arena.autopilot.stored_logs import Content, LogEntry
from arena.background_writer import BackgroundWriter, write_all
from arena.wire.ulog_messages import gap

_PERIOD_S = 0.5  # between two writes [wall time]
_MOST_WRITES = 40  # that wait for a disk that does not respond
_MOST_BYTES = 64 << 20  # collected before a write does not wait for its time
_FLUSH_S = 3.0


@dataclass(slots=True)
class _File:
    """Log file of one flight of a vehicle.

    head: header and definitions
    begun_at: simulation time of the header [s]
    chunks: bytes that were not passed to the thread yet
    ended: True if the flight has ended, so no bytes are added
    fd: file descriptor, used by the thread only; -1 before the file exists
    written_until: simulation time up to which the thread has written [s]
    problem: why the thread stopped writing; "" if it writes
    path, size: path of the file, None before it exists, and its size [bytes]
    """

    name: str
    head: bytes
    begun_at: float
    chunks: list[bytes] = field(default_factory=list)
    ended: bool = False
    fd: int = -1
    written_until: float = 0.0
    problem: str = ""
    path: Path | None = None
    size: int = 0


@dataclass(frozen=True, slots=True)
class _Part:
    """Block of bytes that the writing thread appends to a log file in one write.

    last: True if no bytes follow, so that the thread closes the file. It is stored here, because the flight can end while
    an earlier write of the file is in progress.
    """

    file: _File
    data: bytes
    last: bool


@dataclass(slots=True)
class _Reading:
    """Log file that a background thread reads for a download over MAVLink. See `stored_logs.Content`."""

    ready: bool = False
    data: bytes | None = None

    def read(self, path: Path) -> None:
        """Read the log file from the disk. Only the reading thread calls this method."""
        try:
            self.data = path.read_bytes()
        except OSError:
            self.data = None
        self.ready = True


class UlogFiles:
    """Writes the logs of all vehicles, without blocking the caller.

    This also holds for a disk that is full or does not respond. The operating system decides when it stores the bytes on the disk:
    a killed process loses nothing that was written, and a simulated flight need not survive a power failure. Waiting for the disk
    for each vehicle twice a second would slow down campaigns.

    folder: folder of the files; it is created with the first log
    The first log of a vehicle is `<name>.ulg`, the next ones are `<name>_2.ulg`, `<name>_3.ulg`, ...
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._writer = BackgroundWriter("ulog", _MOST_WRITES)
        self._reader = BackgroundWriter("ulog reader", _MOST_WRITES)
        self._open: dict[str, _File] = {}
        self._all: dict[str, list[_File]] = {}
        self._ended: list[_File] = []
        self._events: list[str] = []
        self._bytes = 0
        self._wrote_at = time.monotonic()
        self._now = 0.0
        self._from = 0.0

    def begin(self, name: str, data: bytes) -> None:
        self._open[name] = _File(name, data, self._now)
        self._all.setdefault(name, []).append(self._open[name])

    def write(self, name: str, data: bytes) -> None:
        self._open[name].chunks.append(data)
        self._bytes += len(data)

    def end(self, name: str) -> None:
        file = self._open.pop(name)
        file.ended = True
        self._ended.append(file)

    def logs(self, vehicle: str) -> list[LogEntry]:
        """Return the logs of a vehicle that exist on the disk, the oldest first."""
        files = self._all.get(vehicle, [])
        return [LogEntry(f.path.name, f.size, f.begun_at) for f in files if f.path is not None]

    def read(self, name: str) -> Content | None:
        """Start to read the log with this file name in a background thread. Return its `Content`.

        Return None if the log does not exist.
        """
        paths = [f.path for files in self._all.values() for f in files if f.path is not None]
        path = next((path for path in paths if path.name == name), None)
        if path is None:
            return None
        reading = _Reading()
        self._reader.submit(lambda: reading.read(path))
        return reading

    def hand_over(self, now: float) -> None:
        """Pass the collected log data to the writing thread twice a second (wall time).

        now: time since boot [s]
        """
        self._now = now
        if time.monotonic() >= self._wrote_at + _PERIOD_S or self._bytes > _MOST_BYTES:
            self._submit()

    def events(self) -> list[str]:
        """Return lines for the event log about failed writes since the last call."""
        if lost := self._writer.take_lost():
            self._events.append(f"ulog: the disk did not respond, so {lost} writes of the logs are missing")
        found, self._events = self._events, []
        return found

    def close(self) -> None:
        """Write all collected log data before the process ends; wait at most 3 s for the disk."""
        self._submit()
        self._writer.flush(_FLUSH_S)

    def _submit(self) -> None:
        files = [*self._ended, *self._open.values()]
        work = [_Part(file, b"".join(file.chunks), last=file.ended) for file in files]
        for file in files:
            file.chunks = []
        since, until = self._from, self._now
        self._ended, self._bytes, self._wrote_at, self._from = [], 0, time.monotonic(), until
        if work:
            self._writer.submit(lambda: self._write(work, since, until))

    # -- in the thread ---------------------------------------------------------------------------------------

    def _write(self, work: list[_Part], since: float, until: float) -> None:
        for part in work:
            file = part.file
            if not file.problem:
                try:
                    self._write_one(part, since, until)
                except OSError as error:
                    file.problem = error.strerror or str(error)
                    self._events.append(f"{file.name}: the ULog ends here: {file.problem}")

    def _write_one(self, part: _Part, since: float, until: float) -> None:
        file, data = part.file, part.data
        if file.fd < 0:
            file.fd, file.path = self._create(file.name)
            file.written_until = file.begun_at
            write_all(file.fd, file.head)
            file.size = len(file.head)
        if since > file.written_until:
            missing = gap(since - file.written_until)
            write_all(file.fd, missing)
            file.size += len(missing)
        write_all(file.fd, data)
        file.size += len(data)
        file.written_until = until
        if part.last:
            os.close(file.fd)

    def _create(self, name: str) -> tuple[int, Path]:
        self._folder.mkdir(parents=True, exist_ok=True)
        for number in range(1, 10_000):
            path = self._folder / (f"{name}.ulg" if number == 1 else f"{name}_{number}.ulg")
            try:
                return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644), path
            except FileExistsError:
                continue
        raise OSError(
            f"{self._folder} contains too many log files of the vehicle {name}: move or delete some"
        )
