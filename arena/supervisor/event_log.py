"""Writes and shows the event log of a run, events.jsonl: state changes and events of the processes."""

from __future__ import annotations

import errno
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path

from arena.background_writer import BackgroundWriter
from arena.supervisor.messages import Level, Message, event_level, transition_text
from arena.supervisor.process_state import State

MAX_EVENT_CHARACTERS = 2000
MAX_EVENTS_PER_PROCESS = 2000
MAX_REQUESTS_PER_PROCESS = 20_000

Show = Callable[[Message], None]
"""Function that shows one line to a person. It never raises, because a closed terminal must not end a flight."""


class EventLog:
    """Writer of events.jsonl. It also shows each entry as a line to the user.

    `lost` counts entries that could not be written.

    writer: background thread that writes the file.
    path: the file.  show: function that shows a line.
    vehicles: names of the vehicles; an event that begins with `<vehicle>: ` is shown as a line about that vehicle.
    time_s: function that returns the time to show in front of a line [s], or None for no time.
    """

    def __init__(
        self,
        path: Path,
        show: Show,
        writer: BackgroundWriter,
        *,
        vehicles: Sequence[str] = (),
        time_s: Callable[[], float | None] = lambda: None,
    ) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self._writer = writer
        self._error, self._error_reported = "", False
        self._show, self._vehicles, self._time_s = show, frozenset(vehicles), time_s
        self._counts: Counter[str] = Counter()
        self._requests: Counter[str] = Counter()
        self.lost = 0
        self._newest = -math.inf

    def transition(
        self, mono: float, process: str, before: State, after: State, reason: str, *, level: Level
    ) -> None:
        """Log a change of the state of a process.

        mono: monotonic time [s].
        """
        self._write(mono, {"process": process, "from": before, "to": after, "reason": reason})
        self.show(Message(source=process, text=transition_text(after, reason), level=level))

    def event(self, mono: float, process: str, text: str, *, level: Level | None = None) -> None:
        """Log an event of a process, such as a fault or a text that the process sent.

        mono: monotonic time [s].  level: level of the shown line; None chooses it from the text.
        Events after the first MAX_EVENTS_PER_PROCESS of a process are dropped.
        """
        self._counts[process] += 1
        if self._counts[process] > MAX_EVENTS_PER_PROCESS:
            return
        last = self._counts[process] == MAX_EVENTS_PER_PROCESS
        text = text[:MAX_EVENT_CHARACTERS] + (" (further events are dropped)" if last else "")
        self._write(mono, {"process": process, "event": text})
        vehicle, _, about = text.partition(": ")
        source, shown = (vehicle, about) if vehicle in self._vehicles else (process, text)
        self.show(Message(source=source, text=shown, level=event_level(text) if level is None else level))

    def audit(self, mono: float, process: str, entry: Mapping[str, object]) -> None:
        """Log a request to a vehicle, for `arena audit`. The request is not shown on the terminal.

        mono: monotonic time [s].

        Requests after the first MAX_REQUESTS_PER_PROCESS of a process are dropped.
        """
        self._requests[process] += 1
        if self._requests[process] <= MAX_REQUESTS_PER_PROCESS:
            self._write(mono, {"process": process, "audit": dict(entry)})

    def show(self, message: Message) -> None:
        """Show a line with the time in front. The line is not written to events.jsonl."""
        self._show(
            Message(text=message.text, source=message.source, level=message.level, time_s=self._time_s())
        )

    def error(self) -> str:
        """Return the reason why events.jsonl cannot be written, such as `No space left on device`.

        Later calls return "", so that the user reads the reason once.
        """
        if not self._error or self._error_reported:
            return ""
        self._error_reported = True
        return self._error

    def close(self) -> None:
        """Close the file after all entries are written."""
        self._writer.submit(partial(os.close, self._file))

    def _write(self, mono: float, entry: dict[str, object]) -> None:
        """Append an entry to the file. Its time is at least that of the entry before, so that times in the file never decrease.

        A state change has the time at which the supervisor's round began, and packets are received within the round.

        mono: monotonic time [s].
        """
        self._newest = max(self._newest, mono)
        wall = datetime.now().astimezone().isoformat(timespec="milliseconds")
        entry = {"t": wall, "mono": self._newest, **entry}
        if (time_s := self._time_s()) is not None:
            entry["time_s"] = round(time_s, 3)
        self._writer.submit(partial(self._append, json.dumps(entry).encode() + b"\n"))

    def _append(self, line: bytes) -> None:
        """Append a line to events.jsonl, in the background thread that writes files.

        If the disk becomes full within the line, the written part of the line is removed, so that the file has whole lines only.
        """
        try:
            written = os.write(self._file, line)
            if written < len(line):
                os.ftruncate(self._file, os.fstat(self._file).st_size - written)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            self._error = self._error or str(error.strerror)
            self.lost += 1
