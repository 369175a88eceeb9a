"""Writes processes.csv in the run folder: CPU load and memory of all processes over time."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

from arena.background_writer import BackgroundWriter, write_all

FILE_NAME = "processes.csv"
HEADER = "time_s,process,cpu,rss_mb"


class LoadLog:
    """Writer of processes.csv, with one row per process and sample.

    It writes nothing after the first error.

    path: the file.  writer: background thread that writes the file.
    time_s: function that returns the time of a row: simulated time, or time since the start of the run [s]. None before the
        world runs.
    """

    def __init__(self, path: Path, writer: BackgroundWriter, time_s: Callable[[], float | None]) -> None:
        self._writer, self._time_s = writer, time_s
        self._file: int | None = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self._write(f"{HEADER}\n")

    def add(self, loads: Mapping[str, tuple[float, float]]) -> None:
        """Write one row per process with its present CPU use and memory.

        loads: process -> (CPU use as a fraction of one core [-], resident memory [MB]).
        """
        if (time_s := self._time_s()) is not None:
            self._write(
                "".join(f"{time_s:.3f},{name},{cpu:.4f},{mb:.1f}\n" for name, (cpu, mb) in loads.items())
            )

    def close(self) -> None:
        """Close the file after all rows are written."""
        self._writer.submit(self._end)

    def _write(self, text: str) -> None:
        self._writer.submit(partial(self._append, text.encode()))

    def _append(self, data: bytes) -> None:
        """Append rows to the file, in the background thread. A full disk ends only this log."""
        if self._file is not None:
            try:
                write_all(self._file, data)
            except OSError:
                self._end()

    def _end(self) -> None:
        if self._file is not None:
            with suppress(OSError):
                os.close(self._file)
            self._file = None
