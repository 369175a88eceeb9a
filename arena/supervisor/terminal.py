"""Output of a run on the terminal: plain lines, JSON lines, or a live table.

Printing never raises an error and never blocks.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.spinner import Spinner
from rich.text import Text

from arena.background_writer import BackgroundWriter, write_to
from arena.supervisor.messages import Level, Message
from arena.supervisor.status_tables import status_view

_REFRESH_S, _LINES_S, _FLUSH_S = 1.0, 0.2, 2.0
_MAX_LINES = 1000
_WAITING_PHASES = ("starting", "landing", "stopping", "making the report")
_STYLES = {Level.DETAIL: "dim", Level.CHANGE: "", Level.RESULT: "bold red"}


class Lines:
    """Output as plain lines on stdout. After the first write error, output goes to /dev/null.

    A thread writes the lines, so that a frozen terminal (Ctrl-S) does not stop the run. Lines that do not fit in its queue are
    counted, and the number is shown when the terminal continues.
    level: lowest level that is shown.
    """

    def __init__(self, level: Level = Level.CHANGE) -> None:
        self.level = level
        self._writer = BackgroundWriter("terminal", _MAX_LINES)
        self._stream = sys.stdout

    def say(self, message: Message) -> None:
        """Show one line of output."""
        if message.level >= self.level:
            self.print(str(message))

    def print(self, text: str) -> None:
        """Print a text at any output level (-q, -v), without waiting until it is written."""
        self._submit(text + "\n")

    def flush(self) -> None:
        """Wait until all output is written, at most _FLUSH_S seconds.

        The terminal may be frozen.
        """
        self._writer.flush(_FLUSH_S)

    def blocked_s(self, now: float) -> float:
        """Return for how long the terminal has accepted no output [s], or 0 if it accepts output.

        now: monotonic [s].
        """
        return self._writer.blocked_s(now)

    def lost_text(self, lost: int) -> str:
        """Return a line that says how many lines of output were lost."""
        return f"{lost} lines are not shown, because the terminal was frozen; `events.jsonl` contains them"

    def _submit(self, text: str) -> None:
        self._writer.submit(partial(self._write, text))

    def _write(self, text: str) -> None:
        """Write a text to stdout in the background thread, because writing to a terminal can block."""
        if lost := self._writer.take_lost():
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
        """Return a JSON object that says how many lines of output were lost."""
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


class _Screen(io.StringIO):
    """Buffer into which the library rich draws for the terminal.

    The text stays in the buffer until `take` is called.
    """

    def isatty(self) -> bool:
        return True

    def take(self) -> str:
        """Return the text in the buffer and empty the buffer."""
        text = self.getvalue()
        self.seek(0)
        self.truncate()
        return text


class LiveTable(Lines):
    """Output on a terminal as lines, with tables of vehicles and processes below.

    The tables are redrawn once a second.

    Nothing is drawn while the terminal accepts no output, because each drawing begins with the removal of the last one. The
    newest lines are kept for the next drawing.
    """

    def __init__(self, level: Level = Level.CHANGE) -> None:
        super().__init__(level)
        self._screen = _Screen()
        self._console = Console(file=self._screen)
        self._live: Live | None = Live(
            console=self._console,
            auto_refresh=False,
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._next = 0.0
        self._waiting: deque[Message] = deque(maxlen=_MAX_LINES)
        self._not_shown = 0
        self._live.start()

    def say(self, message: Message) -> None:
        """Store a line until the next refresh.

        Redrawing the table after every line would slow down the start.
        """
        if self._live is None:
            super().say(message)
        elif message.level >= self.level:
            self._not_shown += len(self._waiting) == _MAX_LINES
            self._waiting.append(message)

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        """Print the stored lines and redraw the tables if the refresh period is over.

        now: monotonic [s].
        """
        if self._live is None or now < self._next - (_REFRESH_S - _LINES_S if self._waiting else 0.0):
            return
        self._next = now + _REFRESH_S
        if self._writer.busy:
            return
        lines = [Text(str(m), style=_STYLES[m.level]) for m in self._waiting]
        if self._not_shown:
            lines.insert(0, Text(self.lost_text(self._not_shown)))
        self._waiting.clear()
        self._not_shown = 0
        if lines:
            self._console.print(Text("\n").join(lines))
        self._live.update(_with_progress(status()), refresh=True)
        self._submit(self._screen.take())

    def close(self) -> None:
        """Remove the tables from the terminal and print the stored lines."""
        live, self._live = self._live, None
        if live is not None:
            live.stop()
            self._submit(self._screen.take())
        for message in self._waiting:
            super().say(message)
        self._waiting.clear()
        self.flush()


def _with_progress(status: dict[str, Any]) -> RenderableType:
    """Return the status tables, with a spinner above them while the run starts, lands, stops or reports."""
    view = status_view(status)
    if status["phase"] not in _WAITING_PHASES:
        return view
    return Group(Spinner("dots", text=str(status["phase"])), view)


def _silence() -> None:
    """Redirect stdout and stderr to /dev/null, so that later writes never raise an error."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
