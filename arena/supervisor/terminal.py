"""What a person sees of a run: plain lines, or a live table under them. Printing never raises and never ends a flight."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

_COLOURS = {
    "READY": "green",
    "STARTING": "yellow",
    "BACKOFF": "magenta",
    "STOPPING": "yellow",
    "FATAL": "bold red",
    "EXITED": "cyan",
    "STOPPED": "dim",
}
_REFRESH_S, _LINES_S = 1.0, 0.2


class Lines:
    """Plain lines on stdout. After the first failure (a terminal that has hung up) stdout becomes /dev/null."""

    def say(self, text: str) -> None:
        try:
            print(text, flush=True)
        except (OSError, ValueError):
            _silence()

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        return

    def started(self, failed: list[str]) -> None:
        return

    def close(self) -> None:
        return


class LiveTable(Lines):
    """Lines above, the table of processes and vehicles below, once a second. For a terminal."""

    def __init__(self) -> None:
        self._console = Console()
        self._live: Live | None = Live(
            console=self._console, auto_refresh=False, transient=True, redirect_stderr=False
        )
        self._next = 0.0
        self._waiting: list[str] = []
        self._live.start()

    def say(self, text: str) -> None:
        """Kept until the next refresh: drawing the table anew below every line would slow the start."""
        if self._live is None:
            super().say(text)
        else:
            self._waiting.append(text)

    def refresh(self, status: Callable[[], dict[str, Any]], now: float) -> None:
        if self._live is None or now < self._next - (_REFRESH_S - _LINES_S if self._waiting else 0.0):
            return
        self._next = now + _REFRESH_S
        lines, self._waiting = self._waiting, []
        try:
            if lines:
                self._console.print(Text("\n".join(lines)))
            self._live.update(picture(status()), refresh=True)
        except (OSError, ValueError):
            self._lost()

    def close(self) -> None:
        live, self._live = self._live, None
        if live is not None:
            with contextlib.suppress(OSError, ValueError):
                live.stop()
        for text in self._waiting:
            super().say(text)

    def _lost(self) -> None:
        _silence()
        self.close()


def picture(status: Mapping[str, Any]) -> Group:
    """The answer of `ps` as two tables. Pure."""
    return (
        Group(processes_table(status), vehicles_table(status))
        if status["vehicles"]
        else Group(processes_table(status))
    )


def processes_table(status: Mapping[str, Any]) -> Table:
    table = Table(
        box=None,
        pad_edge=False,
        title=f"{status['name']}: {status['phase']}, {status['up_s']:.0f} s",
        title_justify="left",
    )
    # in a narrow terminal the last column alone gives way
    longest = max(map(len, status["processes"]), default=0)
    table.add_column("process", no_wrap=True, min_width=longest)
    table.add_column("state", no_wrap=True, min_width=max(map(len, _COLOURS)))
    for name in ("cpu %", "MB", "restarts"):
        table.add_column(name, justify="right", no_wrap=True, min_width=len(name))
    table.add_column("")
    for name, row in status["processes"].items():
        colour = _COLOURS.get(row["state"], "")
        calm = row["state"] in ("READY", "STARTING")
        table.add_row(
            name,
            Text(row["state"], style=colour),
            f"{100 * row['cpu_now']:.0f}",
            f"{row['rss_mb']:.0f}",
            str(row["restarts"] or ""),
            Text(rates(row["stats"]) if calm else str(row["reason"]), no_wrap=True, overflow="ellipsis"),
        )
    return table


def vehicles_table(status: Mapping[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False)
    for name in ("vehicle", "mode", "armed", "landed"):
        table.add_column(name)
    for vehicle in status["vehicles"]:
        told = [status["facts"].get(f"{vehicle}.{what}") for what in ("mode", "armed", "landed")]
        table.add_row(vehicle, *(Text(_word(value)) for value in told))
    return table


def rates(stats: Mapping[str, Any]) -> str:
    """Up to three rates of a process: figures whose name ends in `_hz`."""
    found = [(k, v) for k, v in stats.items() if k.endswith("_hz") and isinstance(v, int | float)]
    return ", ".join(f"{name[:-3]} {value:.1f} Hz" for name, value in found[:3])


def _word(value: Any) -> str:
    return (
        {None: "-", True: "yes", False: "no"}.get(value, str(value))
        if value is None or isinstance(value, bool)
        else str(value)
    )


def _silence() -> None:
    """Whatever is printed from now on goes nowhere: nothing may raise, at exit neither."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
