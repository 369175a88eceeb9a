"""Landing (or stopping) of other users' vehicles by root, in one process per user.

A run folder is written by its owner. A process with the owner's rights can do nothing with its content that the owner
could not do without root.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import pwd
import select
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass

from arena.emergency.active_runs import user_name
from arena.errors import EXIT_FAILED
from arena.run_dirs import pointers_of_others

FOUND_TIMEOUT_S = 1.0
"""Longest wait for the report whether a user has an active run [s]."""
_FOUND, _NONE = b"F", b"N"


@dataclass(kw_only=True)
class UserProcess:
    """Process that lands (or stops) the vehicles of another user, with the rights of that other user.

    pid: process id. pipe: file descriptor on which the process reports whether the user has an active run.
    """

    uid: int
    pid: int
    pipe: int
    _has_runs: bool | None = None

    def has_runs(self) -> bool:
        """Return whether this other user has an active run with a vehicle that land-all or kill-all selects.

        Waits FOUND_TIMEOUT_S at most.
        """
        if self._has_runs is None:
            ready = select.select([self.pipe], [], [], FOUND_TIMEOUT_S)[0]
            self._has_runs = bool(ready) and os.read(self.pipe, 1) == _FOUND
        return self._has_runs

    def wait(self, timeout_s: float, say: Callable[[str], None]) -> int:
        """Wait until the process for the other user has ended, and return its exit code.

        The process is killed after `timeout_s` [s].
        """
        handle = os.pidfd_open(self.pid)
        if not select.select([handle], [], [], timeout_s)[0]:
            say(
                f"NOT CONFIRMED: the vehicles of user {user_name(self.uid)}: no result after {timeout_s:.0f} s"
            )
            os.kill(self.pid, signal.SIGKILL)
        os.close(handle)
        os.close(self.pipe)
        code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return code if code >= 0 else EXIT_FAILED


Work = Callable[[int, Callable[[bool], None]], int]
"""Function that commands the vehicles of one user and returns the exit code. Arguments: user id; function to be called
with whether the user has an active run.
"""


def start_for_others(work: Work) -> list[UserProcess]:
    """Start a process for each other user who has a runtime folder, to land (or stop) that user's vehicles.

    Return an empty list if this user is not root.
    """
    if os.geteuid() != 0:
        return []
    users = sorted({owner for _, owner in pointers_of_others()})
    if users:
        _import_late_modules()
    return [_start(uid, work) for uid in users]


def _import_late_modules() -> None:
    """Import modules that other users may not be able to read, while this process is still root.

    Usually these modules are imported at their first use.
    """
    for name in ("yaml", "serial", "arena.emergency.dispatch"):
        with contextlib.suppress(ImportError):
            importlib.import_module(name)


def _start(uid: int, work: Work) -> UserProcess:
    reader, writer = os.pipe()
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        os.close(writer)
        return UserProcess(uid=uid, pid=pid, pipe=reader)
    code = EXIT_FAILED
    try:
        os.close(reader)
        _become(uid)
        code = work(uid, lambda found: _report(writer, found))
    except BaseException as error:
        with contextlib.suppress(Exception):
            print(
                f"NOT CONFIRMED: the vehicles of user {user_name(uid)}: {type(error).__name__}: {error}. "
                "Watch these vehicles, and run the command again as this user",
                flush=True,
            )
    finally:
        os._exit(code)


def _become(uid: int) -> None:
    """Change the user of this process from root to another user, and give up root's rights."""
    try:
        user = pwd.getpwuid(uid)
        os.initgroups(user.pw_name, user.pw_gid)
        gid = user.pw_gid
    except KeyError:
        gid = uid
        os.setgroups([])
    os.setresgid(gid, gid, gid)
    os.setresuid(uid, uid, uid)


def _report(pipe: int, found: bool) -> None:
    with contextlib.suppress(OSError):
        os.write(pipe, _FOUND if found else _NONE)
