"""Draws `arena top` on the terminal until `q` is pressed, or prints one frame as text."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from rich.console import Console, ConsoleDimensions, RenderableType
from rich.live import Live

from arena.errors import RunError
from arena.live_view import LiveFeed, Snapshot
from arena.top.frame import frame, waiting_frame

DRAW_S, POLL_S = 0.5, 0.05
"""Periods of drawing and of receiving [s]. Receiving must be faster, because the buffers of sockets are small."""
FIRST_FRAME_S = 4.0
"""Longest wait of `--once` for the first data of all vehicles [s]."""
_TEXT_COLUMNS = 140
_PAGE = 10
_SCROLL = {"\x1b[A": -1, "k": -1, "\x1b[B": 1, "j": 1, "\x1b[5~": -_PAGE, "\x1b[6~": _PAGE}


def print_once(run: Path | None, console: Console | None = None) -> None:
    """Print the view of `arena top` once as text. Raises RunError if no arena runs.

    run: run folder; None for the only running arena. Raises RunError if no arena runs.
    """
    feed = LiveFeed(run)
    try:
        snapshot = _first_complete(feed)
    finally:
        waiting_for = feed.waiting_for
        feed.close()
    if snapshot is None:
        raise RunError(waiting_for or "no arena is running. Start one with `arena up`")
    console = console or Console()
    if not console.is_terminal:
        console.width = _TEXT_COLUMNS
    console.print(frame(snapshot))


def _first_complete(feed: LiveFeed) -> Snapshot | None:
    """Return the first complete snapshot of all processes and vehicles.

    After FIRST_FRAME_S seconds, return the last incomplete snapshot.
    """
    deadline, snapshot = time.monotonic() + FIRST_FRAME_S, None
    while time.monotonic() < deadline:
        snapshot = feed.poll()
        if snapshot is None and feed.waiting_for:
            return None
        if snapshot is not None and is_complete(snapshot):
            return snapshot
        time.sleep(POLL_S)
    return snapshot


def is_complete(snapshot: Snapshot) -> bool:
    """Return whether a snapshot is complete: the supervisor has replied, all vehicles have sent state and battery.

    Only vehicles with a tools port count.
    """
    with_port = np.array([v.tools is not None for v in snapshot.settings.vehicles], bool)
    received = np.isfinite(snapshot.fleet.silent_s) & np.isfinite(snapshot.fleet.battery)
    return bool(snapshot.processes) and bool((received | ~with_port).all())


def watch(run: Path | None) -> None:
    """Show the running arena until the user presses `q`. When an arena ends, wait for the next one and show it.

    run: run folder; None for any.
    """
    console, feed, scrolled, next_draw = Console(), LiveFeed(run), 0, 0.0
    try:
        with _keys() as read_key, Live(console=console, screen=True, auto_refresh=False) as live:
            while (key := read_key(POLL_S)) not in ("q", "Q"):
                snapshot = feed.poll()
                scrolled = _scrolled(scrolled, key, snapshot)
                if time.monotonic() >= next_draw or key:
                    next_draw = time.monotonic() + DRAW_S
                    live.update(_picture(snapshot, feed.waiting_for, console.size, scrolled), refresh=True)
    finally:
        feed.close()


def _picture(
    snapshot: Snapshot | None, waiting_for: str, size: ConsoleDimensions, scrolled: int
) -> RenderableType:
    if snapshot is None:
        return waiting_frame(waiting_for or "waiting for the arena")
    return frame(snapshot, width=size.width, height=size.height, scrolled=scrolled)


def _scrolled(scrolled: int, key: str, snapshot: Snapshot | None) -> int:
    vehicles = len(snapshot.fleet.names) if snapshot is not None else 0
    return max(0, min(scrolled + _SCROLL.get(key, 0), vehicles - 1))


@contextlib.contextmanager
def _keys() -> Iterator[Callable[[float], str]]:
    """Read single keys from the terminal without Enter.

    Yields a function: longest wait [s] -> key, or "" if no key was pressed.
    """
    stdin = sys.stdin.fileno()
    if not os.isatty(stdin):
        yield _no_key
        return
    before = termios.tcgetattr(stdin)
    tty.setcbreak(stdin)

    def read(wait_s: float) -> str:
        if not select.select([stdin], [], [], wait_s)[0]:
            return ""
        return os.read(stdin, 16).decode(errors="replace") or "q"  # end of file: the terminal was closed

    try:
        yield read
    finally:
        termios.tcsetattr(stdin, termios.TCSADRAIN, before)


def _no_key(wait_s: float) -> str:
    time.sleep(wait_s)
    return ""
