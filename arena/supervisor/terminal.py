"""Output of a run on the terminal: plain lines, JSON lines, or a live table. Printing never raises, so it cannot end a flight."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Callable
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.spinner import Spinner
from rich.text import Text

from arena.supervisor.messages import Level, Message
from arena.supervisor.status_tables import status_view

_REFRESH_S, _LINES_S = 1.0, 0.2
_WAITING_PHASES = ("starting", "landing", "stopping", "making the report")
_STYLES = {Level.DETAIL: "dim", Level.CHANGE: "", Level.RESULT: "bold red"}


class Lines:
    """Output as plain lines on stdout. After the first write error, such as a closed terminal, output goes to /dev/null.

    level: lowest level that is shown.
    """

    def __init__(self, level: Level = Level.CHANGE) -> None:
        self.level = level

    def say(self, message: Message) -> None:
        """Show one line."""
        if message.level >= self.level:
            self.print(str(message))

    def print(self, text: str) -> None:
        """Print a text. Unlike `say`, this prints at every level of verbosity."""
        try:
            print(text, flush=True)
        except (OSError, ValueError):
            _silence()

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        """Do nothing, because plain lines have no table to redraw."""

    def started(self, failed: list[str]) -> None:
        """Do nothing, because plain lines need no report of the start. The subclass for `arena up --detach` overrides this method."""

    def close(self) -> None:
        """Do nothing, because plain lines have no live table to remove."""


class JsonLines(Lines):
    """Output as one JSON object per line on stdout, for programs."""

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


class LiveTable(Lines):
    """Output on a terminal: lines, and below them the tables of vehicles and processes, redrawn once a second."""

    def __init__(self, level: Level = Level.CHANGE) -> None:
        super().__init__(level)
        self._console = Console()
        self._live: Live | None = Live(
            console=self._console, auto_refresh=False, transient=True, redirect_stderr=False
        )
        self._next = 0.0
        self._waiting: list[Message] = []
        self._live.start()

    def say(self, message: Message) -> None:
        """Keep a line until the next refresh, because redrawing the table after every line would slow the start."""
        if self._live is None:
            super().say(message)
        elif message.level >= self.level:
            self._waiting.append(message)

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        """Print the kept lines and redraw the tables if the refresh period is over. now: monotonic [s]."""
        if self._live is None or now < self._next - (_REFRESH_S - _LINES_S if self._waiting else 0.0):
            return
        self._next = now + _REFRESH_S
        lines, self._waiting = self._waiting, []
        try:
            if lines:
                self._console.print(Text("\n").join(Text(str(m), style=_STYLES[m.level]) for m in lines))
            self._live.update(_with_progress(status()), refresh=True)
        except (OSError, ValueError):
            self._lost()

    def close(self) -> None:
        """Remove the tables and print the kept lines."""
        live, self._live = self._live, None
        if live is not None:
            with contextlib.suppress(OSError, ValueError):
                live.stop()
        for message in self._waiting:
            super().say(message)
        self._waiting = []

    def _lost(self) -> None:
        _silence()
        self.close()


def _with_progress(status: dict[str, Any]) -> RenderableType:
    """Return the status tables. While the run starts, lands, stops or writes its report, add a spinner above them."""
    view = status_view(status)
    if status["phase"] not in _WAITING_PHASES:
        return view
    return Group(Spinner("dots", text=str(status["phase"])), view)


def _silence() -> None:
    """Redirect stdout and stderr to /dev/null, so that later writes do not raise, not even at exit."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
