"""Title of a process."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("setproctitle", reason="setproctitle is not installed")

SCRIPT = """
import sys
from pathlib import Path
from arena.process_title import set_title
set_title(sys.argv[1])
for file in ("cmdline", "environ"):
    print(Path("/proc/self", file).read_text().strip(chr(0)).replace(chr(0), " "))
"""


@pytest.mark.parametrize("title", ["arena:world", "arena:a-title-longer-than-the-command-line-" + 3000 * "x"])
def test_title_is_shown_and_the_environment_stays(title: str) -> None:
    """The supervisor finds the processes of its run by ARENA_RUN, so that none is left when a run ends."""
    made = subprocess.run(
        [sys.executable, "-c", SCRIPT, title],
        env={**os.environ, "ARENA_RUN": "/runs/1", "ARENA_PROCESS": "world"},
        capture_output=True,
        text=True,
        check=True,
    )
    shown, environment = made.stdout.splitlines()
    assert shown.startswith(title[:30])
    assert "ARENA_RUN=/runs/1" in environment.split() and "ARENA_PROCESS=world" in environment.split()
