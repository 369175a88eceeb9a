"""Command line and environment of a forked process, as other processes see them in /proc.

The kernel shows the memory in which the fork server got its command line and environment. A forked process writes its own there: the
supervisor and `arena down` find the processes of a run by their environment, and people find a program by its command line.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

_ARG_START = 45
_OWN_PREFIX = "ARENA_"
_COMMAND_BYTES = 15
"""Longest name of a process, in bytes (proc(5), comm)."""


def show(argv: Sequence[str], env: Mapping[str, str]) -> None:
    """Replace the command line and the environment that /proc shows for this process.

    Texts that do not fit are left out, arena's own variables last.

    The environment of the process must not be in this memory any more: `os.environ` must have been cleared and filled again.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        fields = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
        arg_start, arg_end, env_start, env_end = (int(x) for x in fields[_ARG_START : _ARG_START + 4])
        own_first = sorted(env.items(), key=lambda item: not item[0].startswith(_OWN_PREFIX))
        variables = [f"{key}={value}" for key, value in own_first]
        with Path("/proc/self/mem").open("r+b", buffering=0) as memory:
            for start, end, texts in ((arg_start, arg_end, argv), (env_start, env_end, variables)):
                memory.seek(start)
                memory.write(packed([os.fsencode(text) for text in texts], end - start))
        Path("/proc/self/comm").write_bytes(os.fsencode(Path(sys.executable).name)[:_COMMAND_BYTES])


def packed(texts: Sequence[bytes], size: int) -> bytes:
    """Encode texts for /proc: a zero byte ends each text, and more zero bytes fill the result to `size` bytes.

    A text that does not fit is left out.
    """
    found = b""
    for text in texts:
        if len(found) + len(text) + 1 <= size:
            found += text + b"\0"
    return found.ljust(size, b"\0")
