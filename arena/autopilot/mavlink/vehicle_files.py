"""Files that a vehicle offers over MAVLink: its logs, and the files that describe the autopilot. Encodes no messages."""

from __future__ import annotations

from dataclasses import dataclass

from arena.autopilot.mavlink.component_files import FILES
from arena.autopilot.stored_logs import Content, LogEntry, LogLibrary

LOG_FOLDER = "/log"


@dataclass(frozen=True, slots=True)
class _Ready:
    """File that describes the autopilot, as a `Content` that is already in memory."""

    data: bytes
    ready: bool = True


@dataclass(frozen=True, slots=True)
class VehicleFiles:
    """Files of one vehicle that clients can list and download, by FTP and by the log protocol.

    vehicle: name of the vehicle.  library: the logs, None if no logs are written
    """

    vehicle: str
    library: LogLibrary | None

    def logs(self) -> list[LogEntry]:
        """Return the stored ULog files of the vehicle, the oldest first."""
        return self.library.logs(self.vehicle) if self.library is not None else []

    def read_log(self, name: str) -> Content | None:
        """Start to read a log of this vehicle. Return its `Content`; None if this vehicle has no such log."""
        known = self.library is not None and any(entry.name == name for entry in self.logs())
        return self.library.read(name) if self.library is not None and known else None

    def read(self, path: str) -> Content | None:
        """Start to read the file with this path: a log, or a description of the autopilot. None if it does not exist."""
        if path in FILES:
            return _Ready(FILES[path])
        folder, _, name = path.rpartition("/")
        return self.read_log(name) if folder == LOG_FOLDER else None

    def entries(self, folder: str) -> list[tuple[str, int | None]] | None:
        """Return (name, size [bytes]) of each file and subfolder in a folder; the size of a subfolder is None.

        Return None if the folder does not exist.
        """
        sizes = {path: len(data) for path, data in FILES.items()}
        sizes |= {f"{LOG_FOLDER}/{entry.name}": entry.size for entry in self.logs()}
        root = folder.rstrip("/") + "/"
        found: dict[str, int | None] = {}
        for path, size in sizes.items():
            if path.startswith(root):
                name, deeper, _ = path[len(root) :].partition("/")
                found[name] = None if deeper else size
        if root == "/":
            found[LOG_FOLDER[1:]] = None
        return sorted(found.items()) if found or root in ("/", f"{LOG_FOLDER}/") else None
