"""What every supervised process shares: its slice of the plan, its title, and its line to the supervisor.

The supervisor gives each child one end of a local packet socket (its number in ARENA_FD). The child tells on it, one JSON
object a packet:
    {"entered": true}                it has loaded what it runs on, which is when a start costs no more
    {"ready": true}                  the process serves
    {"facts": {"uav1.armed": true}}  what the supervisor's order and `--until-done` depend on
    {"stats": {...}}                 figures for the table and the summary; the last packet wins, key by key
    {"event": "..."}                 one line for events.jsonl
The socket's end of file means that the supervisor has died. Without ARENA_FD a room runs alone and tells nobody.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from arena.errors import ArenaError, InputError

LIFELINE = "ARENA_FD"


class ProcessContext:
    """One running process of the plan. `stopping` turns true on SIGTERM or SIGINT; loops look at it."""

    def __init__(self, name: str, settings: dict[str, Any], line: socket.socket | None) -> None:
        self.name, self.settings = name, settings
        self.stopping = False
        self.told_nobody = 0
        self._line = line
        self._orphaned = False

    @classmethod
    def enter(cls, argv: list[str] | None = None) -> ProcessContext:
        """Read the slice named by the first argument, take the process title `arena:<name>` and the stop signals.

        Raises InputError when the slice cannot be read.
        """
        arguments = sys.argv[1:] if argv is None else argv
        if len(arguments) != 1:
            raise InputError(
                "expected one argument: the JSON slice that `arena up` writes into the run folder"
            )
        try:
            settings = json.loads(Path(arguments[0]).read_text())
        except (OSError, ValueError) as error:
            raise InputError(f"{arguments[0]}: {error}") from error
        room = cls(str(settings["name"]), settings, lifeline())
        _set_title(f"arena:{room.name}")
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, room._stop)
        room._tell({"entered": True})
        return room

    @property
    def supervised(self) -> bool:
        return self._line is not None

    @property
    def orphaned(self) -> bool:
        """True once the supervisor has died. Costs one system call: ask a few times a second."""
        if self._line is not None and not self._orphaned:
            try:
                self._orphaned = self._line.recv(4096) == b""
            except BlockingIOError:
                pass
            except OSError:
                self._orphaned = True
        return self._orphaned

    def ready(self, **facts: Any) -> None:
        self._tell({"ready": True, "facts": facts} if facts else {"ready": True})

    def facts(self, facts: dict[str, Any]) -> None:
        self._tell({"facts": facts})

    def stats(self, stats: dict[str, Any]) -> None:
        self._tell({"stats": stats})

    def event(self, text: str) -> None:
        self._tell({"event": text})

    def _tell(self, packet: dict[str, Any]) -> None:
        if self._line is None:
            return
        try:
            self._line.send(json.dumps(packet).encode())
        except OSError:  # a stopped supervisor's full buffer, or a dead one: the flight goes on
            self.told_nobody += 1

    def _stop(self, signum: int, frame: FrameType | None) -> None:
        self.stopping = True


def run_room(
    word: str, make: Callable[[ProcessContext], Callable[[], int | None]], argv: list[str] | None = None
) -> int:
    """What a room's `main` does: enter, make what serves from the slice, serve; its exit code. An error is one line on stderr.

    word: what that line begins with. make: may raise KeyError for what the slice lacks, and ArenaError, as may what it returns;
    that one's exit code is its result, 0 for None.
    """
    try:
        room = ProcessContext.enter(argv)
        try:
            serve = make(room)
        except KeyError as error:
            raise InputError(
                f"the slice of {room.name}: {error} is missing (docs/architecture.md, Slices)"
            ) from error
        return serve() or 0
    except ArenaError as error:
        print(f"{word}: {error}", file=sys.stderr)
        return error.exit_code


def lifeline() -> socket.socket | None:
    """This process's end of the line to its supervisor, or None when it has none. Taken out of the environment."""
    number = os.environ.pop(LIFELINE, "")
    if not number:
        return None
    line = socket.socket(fileno=int(number))
    line.setblocking(False)
    line.set_inheritable(False)
    return line


@dataclass(kw_only=True)
class ShutdownPolicy:
    """When a room whose supervisor has died may end: its vehicles disarmed for `settle_s`, or `limit_s` passed.

    limit_s: None for hardware, which is served until it is disarmed. Pure: feed it, then ask it.
    """

    limit_s: float | None = 60.0
    settle_s: float = 2.0
    _orphan_since: float | None = field(default=None, init=False)
    _disarmed_since: float | None = field(default=None, init=False)

    def over(self, *, orphaned: bool, any_armed: bool, now: float) -> bool:
        """now: monotonic [s]. True when this room should end."""
        if not orphaned:
            return False
        if self._orphan_since is None:
            self._orphan_since = now
        if any_armed:
            self._disarmed_since = None
        elif self._disarmed_since is None:
            self._disarmed_since = now
        settled = self._disarmed_since is not None and now - self._disarmed_since >= self.settle_s
        return settled or (self.limit_s is not None and now - self._orphan_since >= self.limit_s)


def _set_title(title: str) -> None:
    try:
        import setproctitle
    except ImportError:  # a nicer `ps`, nothing more
        return
    setproctitle.setproctitle(title)
