"""The process from which tests fork `arena up`: it fails clearly, and ends with the test process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from arena.supervisor import proc_fs

from . import warm_process
from .conftest import own_address
from .flight import eventually

HELP = [sys.executable, "-m", "arena.cli", "up", "--help"]
RUNNER = """
import os, sys, time
from end_to_end import warm_process
arena = warm_process.start([sys.executable, "-m", "arena.cli", *sys.argv[2:]], env=os.environ, output=1)
with open(sys.argv[1], "w") as file:
    print(warm_process._server().pid, arena.pid, file=file)
time.sleep(600)
"""


@pytest.fixture
def own_server(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Use another warm process than the other tests of this worker."""
    monkeypatch.setattr(warm_process, "_started", [])
    yield
    for server in warm_process._started:
        server.close()


def test_dead_warm_process_is_an_error(own_server: None, tmp_path: Path) -> None:
    with (tmp_path / "out").open("wb") as out:
        assert warm_process.start(HELP, env=os.environ, output=out.fileno()).wait(60) == 0
        os.kill(warm_process._server().pid or 0, signal.SIGKILL)
        for _ in ("at first", "and again"):
            with pytest.raises(AssertionError, match="it has died"):
                warm_process.start(HELP, env=os.environ, output=out.fileno())
    assert "--headless" in (tmp_path / "out").read_text()


def test_killed_test_process_leaves_no_process(tmp_path: Path, runtime_dir: Path) -> None:
    file, pids = tmp_path / "arena.yaml", tmp_path / "pids"
    file.write_text(f"address: {own_address()}\nvehicles: {{uav1: {{autopilot: builtin}}}}\n")
    command = ["up", str(file), "--headless", "--no-report", "--runs", str(tmp_path / "runs")]
    with (tmp_path / "out").open("wb") as out:
        runner = subprocess.Popen(
            [sys.executable, "-c", RUNNER, str(pids), *command],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=out,
            stderr=out,
        )
    mark = f"ARENA_RUNTIME_DIR={runtime_dir}"

    def running() -> list[int]:
        started = [pid for pid in psutil.pids() if mark in proc_fs.environment(pid)]
        named = map(int, pids.read_text().split()) if pids.exists() else []
        return [pid for pid in {*started, *named} if proc_fs.start_time(pid) and not proc_fs.is_zombie(pid)]

    try:
        eventually(lambda: "ready" in (tmp_path / "out").read_text(), 60, "the arena")
        assert len(running()) > 3
    finally:
        runner.kill()
        runner.wait()
    eventually(lambda: not running(), 60, "the end of all processes", running)
