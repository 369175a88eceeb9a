"""Downloads of logs from several vehicles at the same time, in one thread.

The thread polls all sockets and serial devices.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from arena.errors import RunError
from arena.log_download.download import LogDownload
from arena.log_download.partial_file import PartialFile
from arena.params.transfer.transfer import Ending, Progress
from arena.params.transfer.transports import ParamTarget, ParamTransport, open_transport
from arena.params.transfer.uid_check import UidCheck
from arena.wire.mavlink_ids import LOG_DOWNLOAD
from arena.wire.mavlink_logs import LogEntry

_POLL_PERIOD_S = 0.02
_PROGRESS_PERIOD_S = 0.1
_SAVE_PERIOD_S = 1.0
OnProgress = Callable[[Mapping[str, Progress]], None]
"""Callback that gets vehicle name -> progress, ten times per second and at the end."""


@dataclass(frozen=True, kw_only=True)
class Fetched:
    """Result of the download of a log from one vehicle.

    ending: "done", or why the download ended early
    why: why the connection could not be opened, why there is no log, or why it could not be written; "" otherwise
    path: the complete log; None if it is not complete
    entry: the log on the vehicle; None if none was chosen
    entries: all logs of the vehicle
    missing: number of bytes that were not received
    seconds: duration [s]
    """

    ending: Ending
    why: str = ""
    path: Path | None = None
    entry: LogEntry | None = None
    entries: tuple[LogEntry, ...] = ()
    missing: int = 0
    seconds: float = 0.0


class _Connection:
    """Connection to one vehicle: the download, its file, and the open socket or serial device."""

    def __init__(
        self, name: str, target: ParamTarget, folder: Path, number: int | None, only_list: bool
    ) -> None:
        suffix = "" if number is None else f"_log{number}"
        self.file = PartialFile(folder / f"{name}{suffix}.ulg")
        now = time.monotonic()
        self.download = LogDownload(
            system=target.system,
            component=LOG_DOWNLOAD.component_at(signs=bool(target.key_file)),
            now=now,
            uid=UidCheck(target.uid) if target.uid else None,
            number=number,
            only_list=only_list,
            resume=self.file.interrupted(),
        )
        self.began = self._saved_at = now
        self.ended = now
        self.why = ""
        self.path: Path | None = None
        self.transport: ParamTransport | None = None
        try:
            self.transport = open_transport(target)
        except RunError as error:
            self.why = str(error)
            self.download.ending = "no connection"

    def read(self) -> None:
        for data, frames in self.transport.read() if self.transport else ():
            for frame in frames:
                self.download.receive(data, frame, time.monotonic())

    def step(self) -> None:
        """Continue a download: write received bytes to the file, and send the requests that are due."""
        download, was_done = self.download, self.download.done
        frames = download.due(time.monotonic())
        try:
            self._write()
        except OSError as error:
            self.why = f"{error.filename or self.file.path}: {error.strerror}"
            download.stop()
        if download.done and not was_done:
            self.ended = time.monotonic()
            frames.append(download.stop_request())
        for frame in frames if self.transport else ():
            self.transport.send(frame)  # type: ignore[union-attr]

    def _write(self) -> None:
        download = self.download
        if download.entry is None or download.missing is None or self.path is not None:
            return
        if pieces := download.take_pieces():
            self.file.write(pieces, resumed=download.resumed)
        if download.complete:
            self.path = self.file.finish()
        elif download.done or time.monotonic() > self._saved_at + _SAVE_PERIOD_S:
            self._saved_at = time.monotonic()
            self.file.save(download.entry, download.missing.ranges)

    def stop(self) -> None:
        """End the download and keep the received bytes, because the user pressed Ctrl-C."""
        self.download.stop()
        self.step()
        if self.transport:
            self.transport.send(self.download.stop_request())

    def result(self) -> Fetched:
        download = self.download
        uid_problem = download.uid.problem if download.uid is not None else ""
        return Fetched(
            ending=download.ending,
            why=self.why or uid_problem or download.problem,
            path=self.path,
            entry=download.entry,
            entries=tuple(download.entries[k] for k in sorted(download.entries)),
            missing=download.missing.left if download.missing is not None else 0,
            seconds=self.ended - self.began,
        )


def fetch_logs(
    targets: Mapping[str, ParamTarget],
    folder: Path,
    *,
    number: int | None = None,
    only_list: bool = False,
    on_progress: OnProgress = lambda progress: None,
) -> dict[str, Fetched]:
    """Download one log from each vehicle to `folder/<vehicle>.ulg`. Return {vehicle: result}.

    number: id of the log; None for the newest one of each vehicle. Its file is then `<vehicle>_log<number>.ulg`
    only_list: list the logs and download none
    An interrupted download is continued by the next call. Ctrl-C ends all downloads.
    """
    connections = {
        name: _Connection(name, target, folder, number, only_list) for name, target in targets.items()
    }
    try:
        _loop(connections, on_progress)
    except KeyboardInterrupt:
        for connection in connections.values():
            connection.stop()
    finally:
        for connection in connections.values():
            connection.file.close()
            if connection.transport is not None:
                connection.transport.close()
    return {name: connection.result() for name, connection in connections.items()}


def _loop(connections: Mapping[str, _Connection], on_progress: OnProgress) -> None:
    poll, next_progress = select.poll(), 0.0
    owners = {c.transport.fileno(): c for c in connections.values() if c.transport is not None}
    for fd in owners:
        poll.register(fd, select.POLLIN)
    while True:
        for connection in connections.values():
            connection.step()
        over = all(connection.download.done for connection in connections.values())
        if over or time.monotonic() >= next_progress:
            next_progress = time.monotonic() + _PROGRESS_PERIOD_S
            on_progress({name: c.download.progress for name, c in connections.items()})
        if over:
            return
        for fd, event in poll.poll(_POLL_PERIOD_S * 1e3):
            owners[fd].read()
            if (
                event & select.POLLHUP
            ):  # the device was unplugged; the time-out of the vehicle ends the download
                poll.unregister(fd)
