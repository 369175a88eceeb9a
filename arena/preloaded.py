"""Starts a fork server as a fork of the running process, so that packages are not imported again.

A process that a fork server has forked can serve as a fork server without a new interpreter: it forks a child, and the child
serves requests. The child gives up the work of its parent by an exception, `OtherWork`, so that it ends as a process of its own.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

Work = Callable[[], int]
Serve = Callable[[socket.socket], Work | None]


class OtherWork(BaseException):
    """Exception with which a forked child leaves the code of its parent, to run the function `work` instead.

    work: does the other work, and returns an exit code.
    """

    def __init__(self, work: Work) -> None:
        super().__init__()
        self.work = work


_serve: list[Serve] = []


def offer(serve: Serve) -> None:
    """Store the function `serve`, which `fork_server` runs in the new fork server.

    The fork server calls this in each process that it forks.

    serve: serves requests that arrive on a socket. Returns None at the end; in a forked process, the work of this process.
    """
    _serve[:] = [serve]


def fork_server(channel: socket.socket, ours: socket.socket) -> int | None:
    """Fork a new fork server from this process and return its pid; None if this process must not be forked.

    A process can be copied if a fork server has forked it, and if it has no second thread: a thread does not survive a fork.
    channel: socket on which the server receives requests.  ours: the other end, which the server closes.
    Raises OtherWork in the server, and in each process that it forks.
    """
    if not _serve or sum(1 for _ in Path("/proc/self/task").iterdir()) > 1:
        return None
    if pid := os.fork():
        return pid
    raise OtherWork(_other_work(channel, ours))


def _other_work(channel: socket.socket, ours: socket.socket) -> Work:
    """Run the fork server. Return the function to run next, in the server at its end or in a child that it has forked.

    In a forked process the function does its work. In the server, at the end of its requests, it does nothing.

    No error may leave this function: the caller of `fork_server` could handle it, and do the work of its parent a second time.
    """
    try:
        ours.close()
        os.setsid()
        nowhere = os.open(os.devnull, os.O_RDWR)
        for number in (0, 1, 2):
            os.dup2(nowhere, number)
        os.close(nowhere)
        work = _serve[0](channel)
    except BaseException:
        os._exit(1)
    return work if work is not None else lambda: 0
