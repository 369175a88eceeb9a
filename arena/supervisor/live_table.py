"""Output of a run on the terminal as a live table, drawn with rich.

Printing never raises an error and never blocks.
"""

from __future__ import annotations

import io
from collections import deque
from collections.abc import Callable
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.spinner import Spinner
from rich.text import Text

from arena.supervisor.messages import Level, Message
from arena.supervisor.status_tables import status_view
from arena.supervisor.terminal import MAX_LINES, Lines

_REFRESH_S, _LINES_S = 1.0, 0.2
_WAITING_PHASES = ("starting", "landing", "stopping", "making the report")
_STYLES = {Level.DETAIL: "dim", Level.CHANGE: "", Level.RESULT: "bold red"}


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
        self._waiting: deque[Message] = deque(maxlen=MAX_LINES)
        self._not_shown = 0
        self._live.start()

    def say(self, message: Message) -> None:
        """Store a line of output. The next `refresh` prints it.

        Redrawing the table after every line would slow down the start.
        """
        if self._live is None:
            super().say(message)
        elif message.level >= self.level:
            self._not_shown += len(self._waiting) == MAX_LINES
            self._waiting.append(message)

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        """Print the stored lines and redraw the tables if the refresh period is over.

        now: monotonic [s].
        """
        if self._live is None or now < self._next - (_REFRESH_S - _LINES_S if self._waiting else 0.0):
            return
        self._next = now + _REFRESH_S
        if self.writer.busy:
            return
        lines = [Text(str(m), style=_STYLES[m.level]) for m in self._waiting]
        if self._not_shown:
            lines.insert(0, Text(self.lost_text(self._not_shown)))
        self._waiting.clear()
        self._not_shown = 0
        if lines:
            self._console.print(Text("\n").join(lines))
        self._live.update(_with_progress(status()), refresh=True)
        self.submit(self._screen.take())

    def close(self) -> None:
        """Remove the tables from the terminal, then print the messages that waited for them."""
        live, self._live = self._live, None
        if live is not None:
            live.stop()
            self.submit(self._screen.take())
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
