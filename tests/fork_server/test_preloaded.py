"""Fork server inside a process: an error in the copy must never let it do the work of its parent."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from arena.fork_server.__main__ import PRELOADED

PROGRAM = """
import contextlib, os, socket
from arena import preloaded

def serve(channel):
    raise {error}

preloaded.offer(serve)
channel, ours = socket.socketpair()
pid = None
with contextlib.suppress(OSError):
    pid = preloaded.fork_server(channel, ours)
os.write(2, b"goes on ")  # not stdout, which the copy redirects
if pid:
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
else:
    os.write({output}, b"the copy goes on")
"""


@pytest.mark.parametrize("name", sorted({name for names in PRELOADED.values() for name in names}))
def test_every_preloaded_module_can_be_imported(name):
    """The fork server leaves out a module that it cannot import, so a wrong name would only cost time."""
    importlib.import_module(name)


def test_error_in_the_copy_ends_the_copy():
    for error in ("ConnectionResetError", "BrokenPipeError", "ValueError", "SystemExit(0)"):
        script = "import os; kept = os.dup(1)\n" + PROGRAM.format(error=error, output="kept")
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
        )
        assert (done.stdout.strip(), done.stderr.strip()) == ("1", "goes on"), error
