"""Start of `arena up` by fork from a warm process: one process per pytest worker, which has imported arena's packages.

`tests/smoke/test_forked_arena.py` compares a forked `arena up` with one in a new interpreter. If a command needs another environment
than the packages were imported in, the forked process executes a new interpreter (`arena.fork_server.forked_process`).
"""

from __future__ import annotations

import atexit
from collections.abc import Mapping, Sequence

import pytest

from arena.smoke.flying.arena_up import fork
from arena.supervisor.fork_client import ForkClient
from arena.supervisor.forked_child import ForkedChild

_REPLY_TIMEOUT_S = 60.0
_PER_TEST = "PYTEST_CURRENT_TEST"
"""Environment variable that pytest changes for each test. Commands do not get it."""

_started: list[ForkClient] = []


def start(argv: Sequence[str], *, env: Mapping[str, str], output: int) -> ForkedChild:
    """Start a command of arena in a new session, by fork. The kernel sends it SIGTERM when the test process dies, even by SIGKILL.

    argv: command line, with the interpreter.  env: complete environment.  output: file descriptor of its stdout and stderr.
    Raises AssertionError if the warm process has died.
    """
    own = {name: value for name, value in env.items() if name != _PER_TEST}
    pid = fork(_server(), argv, own, output)
    assert pid is not None, f"the warm process did not start {argv}: it has died or did not reply"
    return ForkedChild(pid)


def _server() -> ForkClient:
    """Return the client of the warm process of this pytest worker. The first call starts the process."""
    if not _started:
        with pytest.MonkeyPatch.context() as patch:
            patch.delenv(_PER_TEST, raising=False)
            server = ForkClient("flights", reply_timeout_s=_REPLY_TIMEOUT_S)
        _started.append(server)
        atexit.register(server.close)  # if pytest is killed, the process ends because its socket is closed
        assert server.wait_until_ready(), "the warm process did not import arena's packages"
    return _started[0]
