"""World and motion capture that pose as real ones: they have no supervisor, and end with the test process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile

import psutil
import pytest

from arena.supervisor import proc_fs

from .conftest import own_address
from .flight import eventually

pytestmark = pytest.mark.flight
RUNNER = """
import signal, sys, tempfile
from end_to_end.posing import PosingRoom, PosingVehicle

address, tempfile.tempdir = sys.argv[1:]
with PosingRoom(address, PosingVehicle(name="uav1", number=1, position=[0.0, 0.0, 0.0], partner=(address, 15000))):
    print("runs", flush=True)
    signal.pause()
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL], ids=lambda number: number.name)
def test_posing_room_ends_when_the_test_process_is_killed(number: signal.Signals) -> None:
    mark = f"POSING_TEST={os.getpid()}"
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **dict([mark.split("=")])}

    def running() -> list[int]:
        return [p for p in psutil.pids() if mark in proc_fs.environment(p) and not proc_fs.is_zombie(p)]

    with tempfile.TemporaryDirectory(prefix="arena-") as folder:  # short, for the clock's socket
        runner = subprocess.Popen(
            [sys.executable, "-c", RUNNER, own_address(), folder], env=env, stdout=subprocess.PIPE
        )
        assert runner.stdout is not None
        try:
            assert runner.stdout.readline() == b"runs\n"
            assert len(running()) == 3
        finally:
            runner.send_signal(number)
            runner.wait()
            runner.stdout.close()
        try:
            eventually(lambda: not running(), 10, "the end of world and motion capture", running)
        finally:
            for pid in running():
                os.kill(pid, signal.SIGKILL)
