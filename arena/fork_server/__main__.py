"""Process of the fork server, which starts an arena's processes by forking itself.

Command line: `python -m arena.fork_server FD PACKAGES`, from `arena.supervisor.fork_client`. Process title: `arena:fork-server`.

FD is a local packet socket to the client, for example the supervisor. PACKAGES is a key of PRELOADED. Packets, each one JSON object:
    server -> client   {"ready": true}   the packages are imported
    client -> server   a request to fork a process (`forked_process.Request`), with file descriptors:
                       output of the process, the socket `go`, and possibly its socket to the client
    server -> client   {"pid": 123}      the process exists and is a child of the client
The process starts its work when it receives a byte on `go`. If `go` is closed before, the process ends. So a client that has
given up waiting, and has started the process in another way, never gets a second one.

The client must be a subreaper (PR_SET_CHILD_SUBREAPER): each process is forked by an intermediate process that ends at once, and
so becomes a child of the client, which can wait for it as for every other process. End of file on FD ends the server.
A forked process can have a fork server of its own, which is a copy of the process (`arena.preloaded`).
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import socket
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from arena import preloaded
from arena.fork_server.forked_process import DESCRIPTORS, Request, remember_environment, start_work
from arena.process_title import set_title

_PROCESSES = (
    "arena.fused.__main__",  # imports world, motion capture, forwarder, router, sensors and recorder
    "arena.sim.__main__",
    "arena.mocap.emulator.__main__",
    "arena.mocap.natnet.client",
    "arena.pose_forwarder.__main__",
    "arena.mavlink_router.__main__",
    "arena.recorder.__main__",
    "arena.uav.arguments",
    "arena.uav.group.__main__",
)
PRELOADED = {
    "processes": _PROCESSES,
    "flights": (
        *_PROCESSES,
        "arena.autopilot",  # not for one arena: it would begin later, and may have no built-in autopilot
        "arena.cli.up",
        "arena.cli._summary",
        "arena.flight_log.__main__",
        "arena.recorder.foxglove_channels",
        "arena.smoke.flying.worker",
        "arena.smoke.flying.fly_scenario",
        "arena.plan.make",
        "arena.plan.machine",
        "importlib.metadata",
        "mcap.stream_reader",
        "numpy.random",
    ),
}
"""Modules that are imported once, for the processes of one arena, or for many flights. A process imports all other modules itself."""
_MAX_REQUEST_BYTES = 1 << 18
_FEW_COLLECTIONS = 50_000


def main(argv: list[str]) -> int:
    """Run the fork server until its client, for example the supervisor, closes the socket.

    Return an exit code: that of the server, or in a forked process that of its work.
    """
    set_title("arena:fork-server")
    channel = socket.socket(fileno=int(argv[1]))
    remember_environment()
    preload(PRELOADED[argv[2]])
    if sum(1 for _ in Path("/proc/self/task").iterdir()) > 1:
        return 0  # a thread does not survive a fork, and may hold a lock
    preloaded.offer(serve)
    work = serve(channel)
    return 0 if work is None else work()


def preload(names: Iterable[str]) -> None:
    """Import modules once in the fork server, so that the forked processes need not import them.

    A module that cannot be imported is left out: its process reports the error.
    """
    thresholds = gc.get_threshold()
    gc.set_threshold(_FEW_COLLECTIONS)  # imports make no garbage
    for name in names:
        with contextlib.suppress(Exception):
            importlib.import_module(name)
        if name.endswith(".__main__"):
            sys.modules.pop(name, None)
    gc.freeze()  # a collection in a forked process does not touch, and so does not copy, these objects
    gc.set_threshold(*thresholds)


def serve(channel: socket.socket) -> Callable[[], int] | None:
    """Fork a process for each request of the client, until the client closes the socket.

    Return None at the end. In a forked process, return the function that does its work.
    """
    channel.send(json.dumps({"ready": True}).encode())
    while True:
        try:
            data, descriptors, _, _ = socket.recv_fds(channel, _MAX_REQUEST_BYTES, DESCRIPTORS)
        except ConnectionError:  # the client was killed before it read an answer
            return None
        if not data:
            return None
        request = Request(**json.loads(data))
        pid = _fork_twice()
        if pid == 0:
            channel.close()
            return start_work(request, *descriptors)
        for descriptor in descriptors:
            os.close(descriptor)
        channel.send(json.dumps({"pid": pid}).encode())


def _fork_twice() -> int:
    """Fork a process that becomes a child of the client. Return the pid, or 0 in the new process.

    An intermediate process forks it and ends at once.
    """
    reading, writing = os.pipe2(os.O_CLOEXEC)
    if (between := os.fork()) == 0:
        if (pid := os.fork()) == 0:
            os.close(reading)
            os.close(writing)
            return 0
        os.write(writing, str(pid).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        pid = int(pipe.read())
    os.waitpid(between, 0)  # its child has now another parent, the client
    return pid


if __name__ == "__main__":
    sys.exit(main(sys.argv))
