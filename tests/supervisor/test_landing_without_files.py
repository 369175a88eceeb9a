"""Vehicles land although no file can be written: run folder deleted, disk full or not responding, terminal frozen.

A pipe that nobody reads stands for a file on a disk that does not respond: to open it for writing takes for ever.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest

from arena.plan.model import ProcessSpec, Restart
from arena.process_context import SOCKET_VARIABLE

from .conftest import LIMIT_S, eventually, plan_of, spec
from .test_shutdown import armed_by, begin, process_of

CTRL_S, CTRL_Q = b"\x13", b"\x11"


LAND = """
import os, sys
open(sys.argv[3], "w").write("plan readable" if os.path.exists(sys.argv[1] + "/plan.json") else "no plan")
os.remove(sys.argv[2])
"""


def quiet_landing(flag: Path, landed: Path) -> ProcessSpec:
    """A land task that prints nothing. It writes to `landed` whether it could read the plan, and deletes `flag`."""
    argv = (sys.executable, "-c", LAND, "{run}", str(flag), str(landed))
    return spec("land", "", argv=argv, kind="task", cwd="{run}")


@pytest.mark.parametrize("deleted", ["logs", "."])
def test_vehicle_lands_after_the_run_folder_is_deleted(start, tmp_path, deleted):  # review fault 8
    flag, landed = tmp_path / "armed", tmp_path / "landed at"
    flag.touch()
    run = begin(start, armed_by(flag, land_task=quiet_landing(flag, landed)))
    pids = {name: process_of(run, name) for name in ("router", "p")}
    shutil.rmtree(run.folder / deleted)
    run.signal(signal.SIGINT)
    assert run.wait() == 130, run.said()
    assert not flag.exists() and landed.read_text() == "plan readable"
    assert all(not Path(f"/proc/{pid}").exists() for pid in pids.values())


def test_router_restarts_in_the_landing_without_its_log_and_slice(start, tmp_path):  # review fault 8
    flag, go = tmp_path / "armed", tmp_path / "go"
    flag.touch()
    forward = spec(
        "forward.uav1",
        "needs_file",
        "{run}/slices/forward.uav1.json",
        kind="forward",
        vehicle="uav1",
        restart=Restart(mode="on_failure", backoff_s=0.05),
        outlives=True,
    )
    plan = armed_by(
        flag, forward, landing="lands", land_argument=go, slices={"forward.uav1": {"name": "forward.uav1"}}
    )
    run = begin(start, plan)
    run.until("forward.uav1", "READY")
    control = run.control()
    pid = process_of(run, "forward.uav1")
    shutil.rmtree(run.folder)
    run.signal(signal.SIGTERM)
    eventually(lambda: control.ask(do="ps")["phase"] == "landing")
    os.kill(pid, signal.SIGKILL)
    eventually(
        lambda: (
            (r := control.ask(do="ps")["processes"]["forward.uav1"])["starts"] == 2 and r["state"] == "READY"
        )
    )
    flag.unlink()
    go.touch()
    assert run.wait() == 0


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 256 KiB, if this user may mount one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if done.returncode:
        pytest.skip("mounting a file system needs root")
    yield disk
    subprocess.run(["umount", "-l", "-R", str(disk)], check=True)


@pytest.mark.parametrize("trouble", ["full", "read-only"])
def test_vehicle_lands_when_the_disk_cannot_be_written(
    start, tmp_path, small_disk, trouble
):  # review fault 8
    flag = tmp_path / "armed"
    flag.touch()
    plan = armed_by(flag, land_task=quiet_landing(flag, tmp_path / "landed at"))
    run = begin(start, plan, folder=small_disk)
    pid = process_of(run, "p")
    if trouble == "full":
        with contextlib.suppress(OSError), (small_disk / "fill").open("wb", buffering=0) as file:
            while file.write(b"x" * 512):
                pass
    else:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", str(run.folder)], check=True)
    os.kill(pid, signal.SIGKILL)
    run.signal(signal.SIGINT)
    assert run.wait() == 130, run.said()
    assert not flag.exists()
    assert (tmp_path / "landed at").read_text() == "plan readable"
    assert run.said().count("state.json cannot be written") <= 1


def test_run_ends_when_the_disk_of_its_outcome_does_not_respond(start):  # review fault 11
    run = start(plan_of(spec("p", "sleeps", ready="started")))
    run.until("p", "READY")
    os.mkfifo(run.folder / "outcome.json.new")
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert "outcome.json is not written after 5 s, because the disk does not respond" in run.said()


def test_vehicle_lands_when_the_disk_of_the_logs_does_not_respond(start, tmp_path):  # review faults 8 and 11
    flag = tmp_path / "armed"
    flag.touch()
    run = begin(start, armed_by(flag, land_task=quiet_landing(flag, tmp_path / "landed at")))
    log = run.folder / "logs" / "land.log"
    os.mkfifo(log)
    run.signal(signal.SIGINT)
    try:
        assert run.wait() == 130, run.said()
    finally:
        log.unlink()  # the fixture reads the logs
    assert not flag.exists()


PRINTS = """
import os, sys
from arena.process_context import ProcessContext
context = ProcessContext.enter([sys.argv[1]])
print('uav1: armed', flush=True)
print('x' * 100_000, file=sys.stderr, flush=True)
context.event('continues')
"""


def test_process_continues_when_its_log_does_not_respond():  # review faults 8 and 11
    """A pipe takes 64 KiB until somebody reads it."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(LIMIT_S)
    unread, pipe = os.pipe()
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        file.write('{"name": "link.uav1"}')
        file.flush()
        process = subprocess.Popen(
            [sys.executable, "-c", PRINTS, file.name],
            stdout=pipe,
            stderr=pipe,
            env={**os.environ, SOCKET_VARIABLE: str(theirs.fileno())},
            pass_fds=(theirs.fileno(),),
        )
        try:
            packets = [json.loads(ours.recv(4096)) for _ in range(2)]
            assert packets[1] == {"event": "continues"}
            assert process.wait(LIMIT_S) == 0
        finally:
            process.kill()
            process.wait()
            for end in (unread, pipe):
                os.close(end)
            ours.close()
            theirs.close()


def test_log_of_a_process_is_complete_when_it_ends(tmp_path):
    log = tmp_path / "log"
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    (tmp_path / "slice.json").write_text('{"name": "link.uav1"}')
    code = PRINTS + "for i in range(1000): print(i)\nraise ValueError('last words')\n"
    with log.open("wb") as file:
        subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "slice.json")],
            stdout=file,
            stderr=file,
            env={**os.environ, SOCKET_VARIABLE: str(theirs.fileno())},
            pass_fds=(theirs.fileno(),),
            check=False,
        )
    ours.close()
    theirs.close()
    lines = log.read_text().splitlines()
    assert lines[:2] == ["uav1: armed", "x" * 100_000] and lines[2:1002] == [str(i) for i in range(1000)]
    assert lines[-1] == "ValueError: last words"


def test_process_continues_when_its_log_cannot_be_written():  # review fault 8
    """Every write to /dev/full fails, as on a full disk."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file, Path("/dev/full").open("wb") as full:
        file.write('{"name": "link.uav1"}')
        file.flush()
        done = subprocess.run(
            [sys.executable, "-c", PRINTS, file.name],
            stdout=full,
            stderr=full,
            env={**os.environ, SOCKET_VARIABLE: str(theirs.fileno())},
            pass_fds=(theirs.fileno(),),
            check=False,
        )
    theirs.close()
    packets = [json.loads(ours.recv(4096)) for _ in range(2)]
    ours.close()
    assert done.returncode == 0 and packets[1] == {"event": "continues"}


class Terminal:
    """A terminal of a run. A thread reads its output."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        self.text = b""
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self.master, 65536)
            except OSError:
                return
            self.text += data

    def press(self, key: bytes) -> None:
        os.write(self.master, key)


@pytest.mark.parametrize("live", ["live", "lines"])
def test_vehicle_lands_while_the_terminal_is_frozen(start, tmp_path, live):  # review faults 8 and 11
    flag, terminal = tmp_path / "armed", Terminal()
    flag.touch()
    plan = armed_by(flag, spec("noise", "says", kind="tool"))
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120", "LINES": "40"}
    run = start(
        plan, live, stdin=terminal.slave, stdout=terminal.slave, stderr=terminal.slave, env=environment
    )
    os.close(terminal.slave)
    run.until("p", "READY")
    eventually(lambda: b"router" in terminal.text)
    eventually(lambda: run.control().ask(do="ps")["facts"].get("uav1.armed"))
    terminal.press(CTRL_S)
    said = run.control().ask(do="ps")["processes"]["noise"]["stats"].get("n", 0)
    eventually(lambda: run.control().ask(do="ps")["processes"]["noise"]["stats"].get("n", 0) > said + 20)
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert not flag.exists() and run.outcome["landing"] == "landed and disarmed"
    terminal.press(CTRL_Q)
    os.close(terminal.master)
