"""`arena top` without an arena: on a terminal, and as text."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import subprocess
import sys
import termios
import time

import arena.cli as cli

TIMEOUT_S = 30.0


def read_until(fd: int, words: bytes) -> bytes:
    """Return the output of a terminal up to `words`, or everything before the time-out."""
    output, deadline = b"", time.monotonic() + TIMEOUT_S
    while words not in output and time.monotonic() < deadline:
        if select.select([fd], [], [], 0.2)[0]:
            with contextlib.suppress(OSError):
                output += os.read(fd, 65536)
    return output


def test_q_ends_the_view_and_restores_the_terminal(runtime_dir):
    terminal, other = pty.openpty()
    before = termios.tcgetattr(other)
    process = subprocess.Popen(
        [sys.executable, "-m", "arena", "top"],
        stdin=other,
        stdout=other,
        stderr=other,
        env={**os.environ, "TERM": "xterm"},
    )
    try:
        assert b"no arena is running" in read_until(terminal, b"no arena is running")
        os.write(terminal, b"q")
        read_until(terminal, b"\x1b[?1049l")  # the normal screen is back
        assert process.wait(TIMEOUT_S) == 0
        assert termios.tcgetattr(other) == before
    finally:
        process.kill()
        process.wait()
        os.close(terminal)
        os.close(other)


def test_once_without_an_arena_fails_with_what_to_do(runtime_dir, capsys):
    assert cli.main(["top", "--once"]) == 1
    assert capsys.readouterr().err == "arena: no arena is running. Start one with `arena up`\n"
