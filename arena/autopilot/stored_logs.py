"""Interface to the log files of the vehicles. Files are read in the background."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class Content(Protocol):
    """Content of a file that is being read in the background.

    ready: True if reading has ended.  data: the bytes, None before that or if the file could not be read
    """

    @property
    def ready(self) -> bool: ...

    @property
    def data(self) -> bytes | None: ...


class LogEntry(NamedTuple):
    """Log of a vehicle.

    name: file name.  size: [bytes].  begun_s: start of the log, time since boot [s]
    """

    name: str
    size: int
    begun_s: float


class LogLibrary(Protocol):
    """Logs of all vehicles, such as `UlogFiles`. No method waits for a disk."""

    def logs(self, vehicle: str) -> list[LogEntry]:
        """Return the logs of a vehicle, the oldest first."""
        ...

    def read(self, name: str) -> Content | None:
        """Begin to read a log. Return None if it does not exist."""
        ...
