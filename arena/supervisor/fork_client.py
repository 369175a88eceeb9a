"""Client of the fork server (`arena.fork_server`), which forks processes with packages already imported.

This shortens the start of an arena, and of many flights.

For `arena up` the fork server runs only while a simulated arena starts for the first time. Whatever it cannot do, or does not do in
time, is done by a new interpreter. Restarts never use it. In a process that was forked itself, the server is a copy of this process
(`arena.preloaded`); it costs nearly nothing and runs until the end. This module imports the standard library only, so that
`arena up` can start the fork server before it loads anything else.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import selectors
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from arena import preloaded
from arena.constants import PROCESS_ENV
from arena.process_ties import adopting_orphans
from arena.supervisor.forked_child import ForkedChild

LOAD_TIMEOUT_S = {"processes": 5.0, "flights": 30.0}
"""Longest time for which the start of processes waits until the fork server has imported the packages [s]."""
REPLY_TIMEOUT_S = 1.0
_MODULE = "arena.fork_server"
_MAX_PACKET_BYTES = 4096
# The kernel shows command line and environment of a process in the memory that its interpreter got for them at its start. Forked
# processes need more of it than the fork server, because they have longer command lines and more variables.
_SPARE_ARGUMENT, _SPARE_VARIABLE = "-" * 1024, ("ARENA_SPARE_ENVIRONMENT", "-" * 4096)


class ForkClient:
    """Client that starts the fork server (a process with imported packages) and requests processes from it.

    packages: what the server imports: "processes" of one arena, or "flights" for many flights.
    reply_timeout_s: longest time in which the server must start a process [s].
    ready: the fork server has imported the packages.
    is_copy: the fork server is a copy of this process, so it needs no memory of its own.
    Raises preloaded.OtherWork in such a copy.
    """

    def __init__(self, packages: str = "processes", reply_timeout_s: float = REPLY_TIMEOUT_S) -> None:
        self.ready = False
        self._reply_timeout_s = reply_timeout_s
        self._owner = os.getpid()
        self._selector: selectors.BaseSelector | None = None
        self._deadline = time.monotonic() + LOAD_TIMEOUT_S[packages]
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            copy = preloaded.fork_server(theirs, self._channel)
            self.is_copy = copy is not None
            self._server: subprocess.Popen[bytes] | ForkedChild | None = (
                _execute(theirs, packages) if copy is None else ForkedChild(copy)
            )

    def watch(self, selector: selectors.BaseSelector, on_change: Callable[[], None]) -> None:
        """Register the fork server's socket with a selector.

        The selector's data is `on_change` until the fork server is ready or has ended, and `loading` was called.
        """
        self._selector = selector
        selector.register(self._channel, selectors.EVENT_READ, on_change)

    @property
    def pid(self) -> int | None:
        """Process id of the fork server, or None after `close`."""
        return None if self._server is None else self._server.pid

    def loading(self, now: float) -> bool:
        """Return whether the fork server still imports packages, so that new processes must wait for it.

        now: monotonic [s].

        If the fork server has ended or needs too long, it is not used.
        """
        if self._server is None or self.ready:
            return False
        packet = self._receive(0.0)
        if packet is not None:
            self._unwatch()
        self.ready = packet is not None and packet.get("ready") is True
        if (packet is not None and not self.ready) or now > self._deadline:
            self._end_server()
        return self._server is not None and not self.ready

    def serves(self, argv: Sequence[str], *, is_program: bool, cwd: str) -> bool:
        """Return whether the fork server can start a given command line.

        It can start modules of arena, and user programs in Python.
        """
        if not self.ready or self._server is None or len(argv) < 2 or argv[0] != sys.executable:
            return False
        ours = argv[1] == "-m" and argv[2].startswith("arena.")
        return (ours or (is_program and argv[1].endswith(".py"))) and Path(cwd).is_dir()

    def fork(
        self,
        argv: Sequence[str],
        *,
        cwd: str,
        env: Mapping[str, str],
        death_signal: int,
        output: int,
        nice: int = 0,
        channel: int | None = None,
        socket_variable: str = "",
    ) -> int | None:
        """Request a new process and return its pid, or None if the fork server does not start it.

        After None, the fork server is not used any more.

        argv, cwd, env: command line, working folder and complete environment.
        death_signal: signal that the process gets when this process dies; 0: none.  nice: added to the nice value.
        output: file descriptor of its stdout and stderr.
        channel: file descriptor of its socket to this process; None: it has none.
        socket_variable: environment variable for the number that `channel` has in the process.
        """
        request = {
            "argv": list(argv),
            "cwd": cwd,
            "env": dict(env),
            "socket_variable": socket_variable,
            "nice": nice,
            "death_signal": int(death_signal),
            "client": os.getpid(),
        }
        go, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        with go, adopting_orphans():  # the forked process is one of them
            try:
                with theirs:
                    data = json.dumps(request).encode()
                    extra = [] if channel is None else [channel]
                    socket.send_fds(self._channel, [data], [output, theirs.fileno(), *extra])
                packet = self._receive(self._reply_timeout_s)
                pid = packet.get("pid") if packet is not None else None
                if isinstance(pid, int):
                    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)  # raises if it is no child
                    go.send(b"1")
                    return pid
            except OSError:
                pass
        self._end_server()
        return None

    def wait_until_ready(self) -> bool:
        """Wait until the fork server has imported its packages. Return False if it ended or took too long."""
        while self.loading(time.monotonic()):
            select.select([self._channel], [], [], max(0.0, self._deadline - time.monotonic()))
        return self.ready

    def close(self) -> None:
        """End the fork server. The processes that it has started continue."""
        self._end_server()
        self._channel.close()

    def _unwatch(self) -> None:
        if self._selector is not None:
            self._selector.unregister(self._channel)
            self._selector = None

    def _end_server(self) -> None:
        self._unwatch()
        server, self._server = self._server, None
        self.ready = False
        if server is not None and self._owner == os.getpid():  # not in a copy of this process
            server.kill()
            with contextlib.suppress(OSError):
                server.wait()

    def _receive(self, timeout_s: float) -> dict[str, object] | None:
        """Return the next packet of the fork server. Return {} if it has ended, or None after `timeout_s` [s]."""
        try:
            if not select.select([self._channel], [], [], timeout_s)[0]:
                return None
            packet = json.loads(self._channel.recv(_MAX_PACKET_BYTES) or b"{}")
        except (OSError, ValueError):
            return {}
        return packet if isinstance(packet, dict) else {}


def _execute(channel: socket.socket, packages: str) -> subprocess.Popen[bytes]:
    """Start the fork server in a new interpreter.

    channel: the fork server's end of the socket to the client.
    """
    return subprocess.Popen(
        [sys.executable, "-m", _MODULE, str(channel.fileno()), packages, _SPARE_ARGUMENT],
        cwd="/",  # the first entry of sys.path: a folder in which no user has modules
        env={**os.environ, **dict(PROCESS_ENV), "PYTHONHASHSEED": "0", **dict([_SPARE_VARIABLE])},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        pass_fds=(channel.fileno(),),
    )
