"""Ways to show a run: plain lines, lines of JSON, or a live table under lines. Printing never raises and never ends a flight."""

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
    """Plain lines on stdout. After the first failure, such as a closed terminal, stdout becomes /dev/null.

    level: lines below it are not shown.
    """

    def __init__(self, level: Level = Level.CHANGE) -> None:
        self.level = level

    def say(self, message: Message) -> None:
        """Show one line."""
        if message.level >= self.level:
            self.print(str(message))

    def print(self, text: str) -> None:
        """Print a text, whatever the level."""
        try:
            print(text, flush=True)
        except (OSError, ValueError):
            _silence()

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        """Redraw a table if it is due. There is none here."""

    def started(self, failed: list[str]) -> None:
        """Ignore that every process is started: `arena up --detach` uses it."""

    def close(self) -> None:
        """End a live table. There is none here."""


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
    """Lines above, the tables of vehicles and processes below, redrawn once a second. For a terminal."""

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
        """Keep a line until the next refresh: redrawing the table below every line would slow the start."""
        if self._live is None:
            super().say(message)
        elif message.level >= self.level:
            self._waiting.append(message)

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        """Print the lines that wait and redraw the tables, if due. now: monotonic [s]."""
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
        """Remove the tables and print the lines that wait."""
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
    """Return the tables, with a spinner above them while the arena starts, lands, stops or makes the report."""
    view = status_view(status)
    if status["phase"] not in _WAITING_PHASES:
        return view
    return Group(Spinner("dots", text=str(status["phase"])), view)


def _silence() -> None:
    """Redirect stdout and stderr to /dev/null, so that nothing raises from now on, at exit neither."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
