"""File of an incomplete download: `NAME.ulg.part`, with its missing ranges in `NAME.ulg.part.json`."""

from __future__ import annotations

import json
import os
from pathlib import Path

from arena.log_download.download import Interrupted
from arena.log_download.missing_ranges import Range
from arena.wire.mavlink_logs import LogEntry


class PartialFile:
    """File of a log whose download is not complete: `NAME.ulg.part`.

    Every method raises OSError if the disk is full or the folder is not writable.

    path: path of the complete file
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._part = path.with_name(path.name + ".part")
        self._state = path.with_name(path.name + ".part.json")
        self._fd = -1

    def interrupted(self) -> Interrupted | None:
        """Return the state of an interrupted download, or None if no download can be continued."""
        try:
            found = json.loads(self._state.read_text())
            entry = LogEntry(*(int(found[key]) for key in LogEntry._fields))
            missing = tuple((int(a), int(b)) for a, b in found["missing"])
            return Interrupted(entry=entry, missing=missing) if self._part.exists() else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def write(self, pieces: list[tuple[int, bytes]], *, resumed: bool) -> None:
        """Write received parts of the log to the file. pieces: (offset, bytes) of each part.

        resumed: False deletes the parts of an earlier download at the first call.
        """
        if self._fd < 0:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | (0 if resumed else os.O_TRUNC)
            self._fd = os.open(self._part, flags, 0o644)
        for offset, data in pieces:
            os.pwrite(self._fd, data, offset)

    def save(self, entry: LogEntry, missing: tuple[Range, ...]) -> None:
        """Save the list of missing byte ranges in `NAME.ulg.part.json`, next to the file.

        The received bytes are written to the disk first. So the list never lacks a range that is missing in
        the file.
        """
        if self._fd < 0:
            return
        os.fdatasync(self._fd)
        temporary = self._state.with_suffix(".new")
        temporary.write_text(json.dumps({**entry._asdict(), "missing": missing}))
        temporary.replace(self._state)

    def finish(self) -> Path:
        """Rename the complete file to its final name, and return its path.

        An older log keeps its name: then the name of the new log is NAME_2.ulg, and so on.
        """
        self.write([], resumed=True)
        os.fsync(self._fd)
        self.close()
        path, number = self.path, 1
        while path.exists():
            number += 1
            path = self.path.with_name(f"{self.path.stem}_{number}{self.path.suffix}")
        self._part.replace(path)
        self._state.unlink(missing_ok=True)
        return path

    def close(self) -> None:
        """Close the file, even if the download is not complete."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
