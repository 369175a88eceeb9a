"""Common part of every supervised process: its JSON configuration (slice), title and supervisor socket.

The supervisor gives each child one end of a local packet socket; the environment variable ARENA_FD contains its number.
The child sends packets on this socket, each one JSON object:
    {"entered": true}                all modules of the process are loaded
    {"ready": true}                  the process is ready
    {"facts": {"uav1.armed": true}}  values that the supervisor uses for decisions
    {"stats": {...}}                 measurements for the table and the summary; a new value replaces the old one of its key
    {"event": "..."}                 one line for events.jsonl and the terminal
    {"audit": [{...}]}               requests to vehicles, for events.jsonl and `arena audit`
    {"confirmed": 7}                 the request with this `id` was carried out
The supervisor sends requests to the child on the same socket, each one JSON object with the key `do`. A process ignores
requests that it does not know, and requests that it reads later than `expires` (monotonic [s]):
    {"do": "refuse_arming", "why": "..."}  from the first stop signal on: refuse every command that arms a vehicle
    {"do": "permit", "vehicle": "uav1", "by": "..."}  a person permits this real vehicle to arm (link processes)
    {"do": "axes_check", "vehicle": "uav1", "by": "..."}  start the identity and axes check of this real vehicle (link processes)
    {"do": "stop_axes_check", "vehicle": "uav1", "by": "..."}  stop it
    {"do": "body", "vehicle": "uav1", "definition": "..."}  once a second: the definition of its rigid body (link processes)
    {"do": "forget", "vehicle": "uav1", "dead": true}  an operator has declared the vehicle dead: end without waiting for it
    {"do": "operator"}                     once a second while an operator is present
    {"do": "until_done"}                   the run ends when all programs have ended (`arena up --until-done`)
    {"do": "release", "vehicle": "uav1", "by": "..."}  `arena release`: programs may fly the vehicle again
    {"do": "restore", "vehicle": "uav1", "standing": {...}}  after a restart: what the process must enforce again (arena.authority)
    {"do": "was_armed", "vehicle": "uav1"}  after a restart of a hardware link: its vehicle was armed (link processes)
End of file on the socket means that the supervisor has died. Without ARENA_FD a process runs alone and sends nothing.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import json
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

from arena.background_writer import BackgroundWriter, write_all
from arena.errors import ArenaError, InputError
from arena.process_title import set_title

SOCKET_VARIABLE = "ARENA_FD"
"""Environment variable with the number of the socket to the supervisor."""
SUPERVISOR_LOST = {"do": "refuse_arming", "why": "the supervisor has ended"}
"""Request that a process makes to itself when the supervisor has died."""
OPERATOR_TIMEOUT_S = 5.0
"""An operator counts as absent this long after the supervisor's last report of the presence [s]."""
_PACKET_BYTES = 1 << 16
_MAX_LOG_WRITES, _FLUSH_S = 5000, 1.0


class ProcessContext:
    """Configuration of the running process, and its connection to the supervisor.

    name: name of the process, such as `forward.uav1`.
    settings: JSON configuration of the process (slice).
    stopping: True after SIGTERM or SIGINT; the loop of the process checks it and ends.
    unsent: number of times that a packet could not be sent, because the supervisor is stopped or dead.
    """

    def __init__(self, name: str, settings: dict[str, Any], channel: socket.socket | None) -> None:
        self.name, self.settings = name, settings
        self.stopping = False
        self.unsent = 0
        self._unsent_ready, self._unsent_facts = False, dict[str, Any]()
        self._socket = channel
        self._orphaned = False
        self._requests: list[dict[str, Any]] = []
        self._forgotten: set[str] = set()
        self._refused_end = ""
        self._operator_at = float("-inf")

    @classmethod
    def enter(cls, argv: list[str] | None = None) -> ProcessContext:
        """Read the configuration (slice), set the process title `arena:<name>`, handle SIGTERM and SIGINT.

        argv: one argument, the path of the slice; None for the command line.
        Raises InputError if the slice cannot be read.
        """
        arguments = sys.argv[1:] if argv is None else argv
        if len(arguments) != 1:
            raise InputError(
                "expected one argument: the configuration file (slices/*.json in the run folder, from `arena up`)"
            )
        settings = read_slice(Path(arguments[0]))
        context = cls(str(settings["name"]), settings, supervisor_socket())
        if context.supervised:
            _write_output_in_background()
        set_title(f"arena:{context.name}")
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, context._stop)
        context.send({"entered": True})
        return context

    @property
    def supervised(self) -> bool:
        """True if a supervisor has started the process."""
        return self._socket is not None

    @property
    def orphaned(self) -> bool:
        """True if the supervisor has died.

        Each read makes a system call, so read it only a few times a second.
        """
        self._receive()
        return self._orphaned

    def requests(self) -> list[dict[str, Any]]:
        """Return the supervisor's requests since the last call.

        Each call makes a system call.
        """
        self._receive()
        found, self._requests = self._requests, []
        return found

    def confirm(self, request: Mapping[str, Any]) -> None:
        """Report to the supervisor that a request was carried out, if the request has an `id`."""
        if "id" in request:
            self.send({"confirmed": request["id"]})

    def may_end(self, armed: Collection[str]) -> bool:
        """Return whether the process may end: a stop signal has arrived, and no armed vehicle needs this process.

        The process reports once which vehicles need it. They would lose their poses or their connection in the air.
        armed: real vehicles that the process serves and that are armed. Vehicles that the operator has given up
            (`arena forget`) do not count.
        """
        if not self.stopping:
            return False
        self._receive()
        names = ", ".join(sorted(set(armed) - self._forgotten))
        if names and names != self._refused_end:
            self._refused_end = names
            self.event(
                f"stop signal received, but {names} is armed: {self.name} continues until the vehicle is disarmed"
            )
        return not names

    def operator_present(self, now: float) -> bool:
        """Return whether an operator (a person) is present, as the supervisor has reported recently.

        now: monotonic [s].
        """
        return now - self._operator_at <= OPERATOR_TIMEOUT_S

    def ready(self, **facts: Any) -> None:
        """Report to the supervisor that the process is ready.

        facts: first facts, sent in the same packet.
        """
        self._unsent_ready = True
        self.facts(facts)

    def facts(self, facts: dict[str, Any]) -> None:
        """Send facts, which the supervisor uses for its decisions, such as {"uav1.armed": True}.

        Facts that cannot be sent are sent again before the next measurements, because a process sends a fact only when it changes.
        """
        self._unsent_facts |= facts
        self._send_facts()

    def _send_facts(self) -> None:
        """Send the facts, and that the process is ready, unless they were sent before."""
        facts = {"facts": self._unsent_facts} if self._unsent_facts else {}
        packet = {"ready": True, **facts} if self._unsent_ready else facts
        if packet and self.send(packet):
            self._unsent_ready, self._unsent_facts = False, {}

    def stats(self, stats: dict[str, Any]) -> None:
        """Send measurements to the supervisor, such as {"rate_hz": 99.8}.

        They are shown in the status table and in the summary. Facts that could not be sent are sent first.
        """
        self._send_facts()
        self.send({"stats": stats})

    def event(self, text: str) -> None:
        """Send one line to the supervisor, for events.jsonl and the terminal."""
        self.send({"event": text})

    def audit(self, entries: list[dict[str, Any]]) -> None:
        """Report to the supervisor the requests that were sent to vehicles, for `arena audit`.

        entries: one entry for each request; nothing is sent if the list is empty
        """
        if entries:
            self.send({"audit": entries})

    def _receive(self) -> None:
        while self._socket is not None and not self._orphaned:
            try:
                data = self._socket.recv(_PACKET_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._orphaned = True
                return
            with contextlib.suppress(ValueError):
                if isinstance(packet := json.loads(data), dict):
                    self._take(packet)

    def _take(self, packet: dict[str, Any]) -> None:
        if packet.get("expires", float("inf")) < time.monotonic():
            return  # this process was paused, and the sender has given up
        if packet.get("do") == "forget":
            change = self._forgotten.discard if packet.get("dead") is False else self._forgotten.add
            change(str(packet.get("vehicle")))
        elif packet.get("do") == "operator":
            self._operator_at = time.monotonic()
        else:
            self._requests.append(packet)

    def send(self, packet: dict[str, Any]) -> bool:
        """Send one packet to the supervisor. Return False if it could not be sent.

        Such a packet is counted. Without a supervisor, nothing is sent.
        """
        if self._socket is None:
            return True
        try:
            self._socket.send(json.dumps(packet).encode())
        except OSError:  # the supervisor is stopped or dead: the flight goes on
            self.unsent += 1
            return False
        return True

    def _stop(self, signum: int, frame: FrameType | None) -> None:
        self.stopping = True


def run_process(
    error_prefix: str,
    make: Callable[[ProcessContext], Callable[[], int | None]],
    argv: list[str] | None = None,
) -> int:
    """Run a supervised process and return its exit code.

    An ArenaError is printed as one line on stderr.

    error_prefix: text at the beginning of an error line, such as the name of the process.
    make: function that builds the serve function from the context. The serve function runs until the process ends and
        returns the exit code; None means 0. Both functions may raise ArenaError. `make` may raise KeyError for a missing
        key of the configuration (slice).
    """
    try:
        context = ProcessContext.enter(argv)
        try:
            serve = make(context)
        except KeyError as error:
            raise InputError(
                f"configuration file of {context.name}: the key {error} is missing. "
                "`arena up` writes this file; its keys are in docs/reference/slices.md"
            ) from error
        return serve() or 0
    except ArenaError as error:
        print(f"{error_prefix}: {error}", file=sys.stderr)
        return error.exit_code


class Loop(Protocol):
    """Interface of the main loop of a supervised process.

    `run` returns when the process must end. `close` closes its sockets and files.
    """

    def run(self) -> None: ...

    def close(self) -> None: ...


def run_and_close(loop: Loop) -> Callable[[], None]:
    """Return a function that runs a main loop and then closes its sockets and files, for `run_process`.

    The loop is closed after an error, too.
    """

    def serve() -> None:
        try:
            loop.run()
        finally:
            loop.close()

    return serve


def read_slice(path: Path) -> dict[str, Any]:
    """Read the configuration (slice) of a process.

    Raises InputError if the file cannot be read.

    path: JSON file that `arena up` has written for the process (called slice)
    """
    try:
        settings: dict[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}") from error
    return settings


def supervisor_socket() -> socket.socket | None:
    """Return the socket to the supervisor; None if no supervisor started this process.

    Removes ARENA_FD from the environment.
    """
    number = os.environ.pop(SOCKET_VARIABLE, "")
    if not number:
        return None
    channel = socket.socket(fileno=int(number))
    channel.setblocking(False)
    channel.set_inheritable(False)
    return channel


@dataclass(kw_only=True)
class ShutdownPolicy:
    """Rule that decides when a process ends after its supervisor has died. Pure.

    The process ends when its vehicles have been disarmed for `settle_s`, or `limit_s` after the death of the supervisor.

    settle_s: time for which the vehicles must be disarmed [s].
    limit_s: longest time after the death of the supervisor [s]; None (for real vehicles) means no limit.
    """

    limit_s: float | None = 60.0
    settle_s: float = 2.0
    _orphan_since: float | None = field(default=None, init=False)
    _disarmed_since: float | None = field(default=None, init=False)

    def over(self, *, orphaned: bool, any_armed: bool, now: float) -> bool:
        """Return whether the process must end now because its supervisor has died.

        orphaned: the supervisor has died.  any_armed: a vehicle that the process serves is armed.  now: monotonic [s].
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


class _LogFile(io.FileIO):
    """Log file of a process, written by a thread.

    Printing must not end or delay a flight.

    A write that fails, for example on a full disk, is dropped. Writes to a disk that does not respond wait in a queue.
    """

    def __init__(self, number: int, writer: BackgroundWriter) -> None:
        super().__init__(number, "w", closefd=False)
        self._writer = writer

    def write(self, data: Any, /) -> int:
        copied = bytes(data)
        self._writer.submit(partial(self._write, copied))
        return len(copied)

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            write_all(self.fileno(), data)


def _write_output_in_background() -> None:
    """Replace stdout and stderr by streams whose write methods never raise an error and never block."""
    writer = BackgroundWriter("log", _MAX_LOG_WRITES)
    atexit.register(writer.flush, _FLUSH_S)
    for name, number in (("stdout", 1), ("stderr", 2)):
        raw = io.BufferedWriter(_LogFile(number, writer))
        setattr(sys, name, io.TextIOWrapper(raw, errors="backslashreplace", line_buffering=True))
