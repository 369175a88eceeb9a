"""Output of a run on the terminal: plain lines or JSON lines.

Printing never raises an error and never blocks.
The live table is in a module of its own (`live_table.py`), because rich needs 20 ms to load, and each `arena up` would start later.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

from arena.background_writer import BackgroundWriter, write_to
from arena.supervisor.messages import Level, Message

_FLUSH_S = 2.0
MAX_LINES = 1000
"""Number of lines that are kept while the terminal accepts no output."""


class Lines:
    """Output as plain lines on stdout. After the first write error, output goes to /dev/null.

    A thread writes the lines, so that a frozen terminal (Ctrl-S) does not stop the run. Lines that do not fit in its queue are
    counted, and the number is shown when the terminal continues.
    level: lowest level that is shown.  writer: the thread that writes.
    """

    def __init__(self, level: Level = Level.CHANGE) -> None:
        self.level = level
        self.writer = BackgroundWriter("terminal", MAX_LINES)
        self._stream = sys.stdout

    def say(self, message: Message) -> None:
        """Show one line of output."""
        if message.level >= self.level:
            self.print(str(message))

    def print(self, text: str) -> None:
        """Print a text at any output level (-q, -v), without waiting until it is written."""
        self.submit(text + "\n")

    def flush(self) -> None:
        """Wait until all output is written, at most _FLUSH_S seconds.

        The terminal may be frozen.
        """
        self.writer.flush(_FLUSH_S)

    def blocked_s(self, now: float) -> float:
        """Return for how long the terminal has accepted no output [s], or 0 if it accepts output.

        now: monotonic [s].
        """
        return self.writer.blocked_s(now)

    def lost_text(self, lost: int) -> str:
        """Return a line that says how many lines of output were lost."""
        return f"{lost} lines are not shown, because the terminal was frozen; `events.jsonl` contains them"

    def submit(self, text: str) -> None:
        """Write a text without a line end to stdout, in the background thread."""
        self.writer.submit(partial(self._write, text))

    def _write(self, text: str) -> None:
        """Write a text to stdout in the background thread, because writing to a terminal can block."""
        if lost := self.writer.take_lost():
            text = f"{self.lost_text(lost)}\n{text}"
        try:
            write_to(self._stream, text)
        except (OSError, ValueError):
            _silence()

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        """Do nothing, because plain lines need no redrawing."""

    def started(self, failed: list[str]) -> None:
        """Do nothing. Output modes override this method to act when the start of the arena is complete."""

    def close(self) -> None:
        """Wait until all output is written. More lines can be printed afterwards."""
        self.flush()


class JsonLines(Lines):
    """Output as one JSON object per line on stdout, for programs."""

    def lost_text(self, lost: int) -> str:
        """Return a line of JSON for the reading program, with the number of lines that it missed."""
        return json.dumps(
            {"time_s": None, "source": "", "level": "change", "text": f"{lost} lines were dropped"}
        )

    def say(self, message: Message) -> None:
        """Print a message as {"time_s": ..., "source": ..., "level": ..., "text": ...}."""
        if message.level >= self.level:
            entry = {
                "time_s": None if message.time_s is None else round(message.time_s, 3),
                "source": message.source,
                "level": message.level.name.lower(),
                "text": message.text,
            }
            self.print(json.dumps(entry))


def _silence() -> None:
    """Redirect stdout and stderr to /dev/null, so that later writes never raise an error."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
