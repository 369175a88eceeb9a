"""The process of the page: what it reports, and when."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import urllib.request

import pytest

from arena.process_context import SOCKET_VARIABLE

pytest.importorskip("viser")


@pytest.fixture
def start(tmp_path):
    """A function that starts `arena monitor` without a running arena; with a socket as by a supervisor."""
    processes = []

    def started(channel: socket.socket | None = None):
        env = {**os.environ, "ARENA_RUNTIME_DIR": str(tmp_path)}
        if channel is not None:
            env[SOCKET_VARIABLE] = str(channel.fileno())
        processes.append(
            subprocess.Popen(
                [sys.executable, "-m", "arena.monitor", "--port", "0"],
                stdout=subprocess.PIPE,
                text=True,
                env=env,
                pass_fds=[] if channel is None else [channel.fileno()],
            )
        )
        return processes[-1]

    yield started
    for process in processes:
        process.terminate()
        process.communicate(timeout=60)


def test_url_is_reported_to_the_supervisor_when_the_page_answers(start):
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        start(theirs)
        ours.settimeout(60.0)
        event = json.loads(ours.recv(1 << 16))["event"]
    found = re.fullmatch(r"watch live: (http://127\.0\.0\.1:\d+/)", event)
    assert found is not None, event
    with urllib.request.urlopen(found[1], timeout=30.0) as reply:
        assert reply.status == 200


def test_page_without_an_arena_says_so_on_the_terminal(start):
    process = start()
    lines = [process.stdout.readline(), process.stdout.readline()]
    assert lines[0].startswith("watch the arena: http://127.0.0.1:")
    assert lines[1] == "the page is still empty: no arena is running. Start one with `arena up`\n"
