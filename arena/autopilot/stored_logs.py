"""Interface to the stored ULog files of the vehicles, which a background thread reads from the disk."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class Content(Protocol):
    """Content of a file for a download over MAVLink, which a background thread reads from the disk.

    ready: True if reading has ended.  data: the bytes, None before that or if the file could not be read
    """

    @property
    def ready(self) -> bool: ...

    @property
    def data(self) -> bytes | None: ...


class LogEntry(NamedTuple):
    """Entry in the list of the logs of a vehicle: file name, size and start time.

    name: file name.  size: [bytes].  begun_s: start of the log, time since boot [s]
    """

    name: str
    size: int
    begun_s: float


class LogLibrary(Protocol):
    """Interface to the stored logs of all vehicles, such as `UlogFiles`. No method waits for a disk."""

    def logs(self, vehicle: str) -> list[LogEntry]:
        """Return the logs of a vehicle, the oldest first."""
        ...

    def read(self, name: str) -> Content | None:
        """Start to read the log with this file name. Return its `Content`; None if the log does not exist."""
        ...
