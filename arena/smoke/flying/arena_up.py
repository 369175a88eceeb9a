"""Start of `arena up` as a process: in a new interpreter, or forked from a process that has imported its packages."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from arena.constants import PROCESS_ENV
from arena.process_ties import set_death_signal
from arena.supervisor.fork_client import ForkClient
from arena.supervisor.forked_child import ForkedChild

_forks: list[ForkClient] = []


def use(forks: ForkClient) -> None:
    """Set the fork server that starts each `arena up` of this process, so that no packages are imported again."""
    _forks[:] = [forks]


def start(argv: Sequence[str], env: Mapping[str, str], output: Path) -> subprocess.Popen[bytes] | ForkedChild:
    """Start `arena up` in a new session. The kernel sends it SIGTERM when this process dies.

    argv: command line, with the interpreter.  env: complete environment.  output: file for its stdout and stderr.
    """
    with output.open("wb") as out:
        if _forks and (pid := fork(_forks[0], argv, env, out.fileno())) is not None:
            return ForkedChild(pid)
        return start_interpreter(argv, env, out.fileno())


def start_interpreter(argv: Sequence[str], env: Mapping[str, str], output: int) -> subprocess.Popen[bytes]:
    """Start a command in a new interpreter and session. The kernel sends it SIGTERM when this process dies.

    argv: command line.  env: complete environment.  output: file descriptor for its stdout and stderr.
    """
    return subprocess.Popen(
        argv,
        stdout=output,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        env=env,
        preexec_fn=partial(set_death_signal, signal.SIGTERM),  # noqa: PLW1509  nothing else is done in it
    )


def fork(forks: ForkClient, argv: Sequence[str], env: Mapping[str, str], output: int) -> int | None:
    """Request `arena up` from the fork server. Return its pid, or None if the fork server does not start it."""
    cwd = str(Path.cwd())
    if not forks.wait_until_ready() or not forks.serves(argv, is_program=False, cwd=cwd):
        return None
    environment = {**env, **dict(PROCESS_ENV)}  # the packages were imported with these variables
    return forks.fork(argv, cwd=cwd, env=environment, death_signal=signal.SIGTERM, output=output)
