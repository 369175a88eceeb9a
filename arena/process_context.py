"""The frame of every supervised process: its slice of the plan, its title, and its socket to the supervisor.

The supervisor gives each child one end of a local packet socket (its number in ARENA_FD). The child sends on it, one JSON
object per packet:
    {"entered": true}                its modules are loaded, so that its start costs no more CPU
    {"ready": true}                  the process serves
    {"facts": {"uav1.armed": true}}  values that the supervisor's decisions and `--until-done` depend on
    {"stats": {...}}                 figures for the table and the summary; the last packet wins, key by key
    {"event": "..."}                 one line for events.jsonl and the terminal
The socket's end of file means that the supervisor has died. Without ARENA_FD a process runs alone and sends nothing.
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

SOCKET_VARIABLE = "ARENA_FD"
"""Environment variable with the number of the socket to the supervisor."""


class ProcessContext:
    """The running process, as its plan describes it.

    settings: its slice.  stopping: True after SIGTERM or SIGINT; loops check it.
    unsent: packets that the supervisor did not take, because it is stopped or dead.
    """

    def __init__(self, name: str, settings: dict[str, Any], channel: socket.socket | None) -> None:
        self.name, self.settings = name, settings
        self.stopping = False
        self.unsent = 0
        self._socket = channel
        self._orphaned = False

    @classmethod
    def enter(cls, argv: list[str] | None = None) -> ProcessContext:
        """Read the slice named by the first argument, set the process title `arena:<name>` and handle the stop signals.

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
        context = cls(str(settings["name"]), settings, supervisor_socket())
        _set_title(f"arena:{context.name}")
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, context._stop)
        context._send({"entered": True})
        return context

    @property
    def supervised(self) -> bool:
        """True when a supervisor started the process."""
        return self._socket is not None

    @property
    def orphaned(self) -> bool:
        """True once the supervisor has died. Costs one system call: read it a few times a second."""
        if self._socket is not None and not self._orphaned:
            try:
                self._orphaned = self._socket.recv(4096) == b""
            except BlockingIOError:
                pass
            except OSError:
                self._orphaned = True
        return self._orphaned

    def ready(self, **facts: Any) -> None:
        """Report that the process serves."""
        self._send({"ready": True, "facts": facts} if facts else {"ready": True})

    def facts(self, facts: dict[str, Any]) -> None:
        """Send facts, such as {"uav1.armed": True}."""
        self._send({"facts": facts})

    def stats(self, stats: dict[str, Any]) -> None:
        """Send figures for the table and the summary."""
        self._send({"stats": stats})

    def event(self, text: str) -> None:
        """Send one line for events.jsonl and the terminal."""
        self._send({"event": text})

    def _send(self, packet: dict[str, Any]) -> None:
        if self._socket is None:
            return
        try:
            self._socket.send(json.dumps(packet).encode())
        except OSError:  # the supervisor is stopped or dead: the flight goes on
            self.unsent += 1

    def _stop(self, signum: int, frame: FrameType | None) -> None:
        self.stopping = True


def run_room(
    word: str, make: Callable[[ProcessContext], Callable[[], int | None]], argv: list[str] | None = None
) -> int:
    """Run a supervised process and return its exit code. An error becomes one line on stderr.

    word: what the line of an error begins with.
    make: builds the serve function from the context. Both may raise ArenaError; `make` may raise KeyError for a key that
        the slice lacks. The serve function returns the exit code, None for 0.
    """
    try:
        context = ProcessContext.enter(argv)
        try:
            serve = make(context)
        except KeyError as error:
            raise InputError(
                f"the slice of {context.name}: {error} is missing (docs/architecture.md, Slices)"
            ) from error
        return serve() or 0
    except ArenaError as error:
        print(f"{word}: {error}", file=sys.stderr)
        return error.exit_code


def supervisor_socket() -> socket.socket | None:
    """Return this process's end of the socket to its supervisor, or None without one. Removes it from the environment."""
    number = os.environ.pop(SOCKET_VARIABLE, "")
    if not number:
        return None
    channel = socket.socket(fileno=int(number))
    channel.setblocking(False)
    channel.set_inheritable(False)
    return channel


@dataclass(kw_only=True)
class ShutdownPolicy:
    """Decides when a process whose supervisor has died may end: its vehicles are disarmed for `settle_s`, or `limit_s` is over.

    limit_s: time since the death of the supervisor [s]; None for hardware, which is served until it is disarmed.
    Pure: no clock, no socket.
    """

    limit_s: float | None = 60.0
    settle_s: float = 2.0
    _orphan_since: float | None = field(default=None, init=False)
    _disarmed_since: float | None = field(default=None, init=False)

    def over(self, *, orphaned: bool, any_armed: bool, now: float) -> bool:
        """Return True when the process should end.

        orphaned: the supervisor has died.  any_armed: a vehicle that it serves is armed.  now: monotonic [s].
        """
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
    except ImportError:  # the title is only for `ps`
        return
    setproctitle.setproctitle(title)
