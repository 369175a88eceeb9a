"""The process `python -m arena.px4` with the stand-in as PX4: its folder, start, end and errors."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from arena.autopilot.sitl_standin import BANNER, UP
from arena.errors import RunError
from arena.px4 import __main__ as room
from arena.px4.__main__ import check_free, environment, make_folder, param_text

from .fake import World
from .test_standin import slice_of

START_S = 120.0  # two Python processes, on a busy machine


@pytest.fixture
def world() -> Iterator[World]:
    made = World(1)
    yield made
    made.links.close()


@pytest.fixture
def settings(tmp_path: Path, world: World) -> dict[str, Any]:
    """Return the slice of a vehicle whose simulator API `world` serves."""
    made = slice_of(tmp_path, world.address)
    _, port = world.places[0]
    made["scripts"]["px4-rc.mavlinksim"] = made["scripts"]["px4-rc.mavlinksim"].replace("24079", str(port))
    return made


class Started:
    """The process with a socket to this test as its supervisor."""

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        (folder / "slice.json").write_text(json.dumps(settings))
        self.line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.out = folder / "out.txt"
        argv = [sys.executable, "-m", "arena.px4", str(folder / "slice.json")]
        env = {**os.environ, "ARENA_FD": str(theirs.fileno())}
        with self.out.open("wb") as out:
            self.process = subprocess.Popen(argv, stdout=out, stderr=out, env=env, pass_fds=[theirs.fileno()])
        theirs.close()
        self.line.setblocking(False)
        self.packets: list[dict[str, Any]] = []

    def receive(self) -> list[dict[str, Any]]:
        while True:
            try:
                packet = self.line.recv(65536)
            except BlockingIOError:
                return self.packets
            if not packet:
                return self.packets
            self.packets.append(json.loads(packet))

    @property
    def output(self) -> str:
        return self.out.read_text()

    def standin(self) -> psutil.Process:
        (child,) = psutil.Process(self.process.pid).children()
        return child

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.line.close()


@pytest.fixture
def started(tmp_path: Path, settings: dict[str, Any]) -> Iterator[Started]:
    made = Started(tmp_path, settings)
    yield made
    made.end()


def until_ready(started: Started, world: World) -> None:
    world.until(lambda: {"ready": True} in started.receive() and world.status() == ["in step"], START_S)


def test_process_is_ready_with_the_stand_in_and_ends_it(started: Started, world: World) -> None:
    until_ready(started, world)
    world.until(lambda: UP in started.output, START_S)
    assert BANNER in started.output
    child = started.standin()
    assert child.cmdline()[-6:-1] == ["-d", "-i", "6", "-w", str(Path(child.cmdline()[-2]))]
    world.step(50)
    started.process.send_signal(signal.SIGTERM)
    world.until(lambda: started.process.poll() is not None)
    assert started.process.returncode == 0 and not child.is_running()
    assert not list(Path(tempfile.gettempdir()).glob(f"arena-standin-*-{world.address}-*"))
    assert not [t for t in started.receive() if "event" in t]


def test_restarted_px4_gets_its_folder_again(settings: dict[str, Any]) -> None:
    folder = make_folder(settings)
    (folder / "log").mkdir()
    settings["scripts"] = {**settings["scripts"], "rcS": "new"}
    assert make_folder(settings) == folder
    assert (folder / "etc" / "init.d-posix" / "rcS").read_text() == "new" and (folder / "log").is_dir()


def test_px4_variables_of_the_users_shell_do_not_reach_px4(settings: dict[str, Any]) -> None:
    shell = {
        "PATH": "/bin",
        "PX4_PARAM_MPC_XY_VEL_MAX": "12",
        "PX4_SYS_AUTOSTART": "4001",
        "PX4_SIMULATOR": "gz",
    }
    found = environment({**settings, "params": {"MPC_XY_P": 0.9}, "model": "none_iris", "env": {}}, shell)
    assert found == {"PATH": "/bin", "PX4_PARAM_MPC_XY_P": "0.9", "PX4_SIM_MODEL": "none_iris"}


def test_a_killed_px4_is_an_event_and_exit_code_1(started: Started, world: World) -> None:
    until_ready(started, world)
    started.standin().kill()
    world.until(lambda: started.process.poll() is not None)
    assert started.process.returncode == 1
    told = "uav1: PX4 has ended by itself (killed by SIGKILL); nothing flies this vehicle any more"
    assert {"event": told} in started.receive() and {
        "stats": {"ended": "killed by SIGKILL"}
    } in started.packets
    assert told in started.output
    world.until(lambda: world.status() == ["gone"])


def replaced(settings: dict[str, Any], folder: Path, script: str) -> dict[str, Any]:
    """Return the slice with another binary, a shell script."""
    binary = folder / "binary"
    binary.write_text(f"#!/bin/sh\n{script}\n")
    binary.chmod(0o755)
    return {**settings, "argv": [str(binary)]}


def until_ended(started: Started) -> list[str]:
    """Wait for the end of the process and return its events."""
    started.process.wait(START_S)
    return [t["event"] for t in started.receive() if "event" in t]


def test_a_px4_that_ends_early_is_reported_with_its_last_line(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    started = Started(
        tmp_path, replaced(settings, tmp_path, "echo 'libfoo.so.1: no such file' >&2; exit 127")
    )
    try:
        (told,) = until_ended(started)
    finally:
        started.end()
    assert told.startswith(
        "uav1: PX4 ended before it was ready (exit 127): start its binary by hand to see why."
    )
    assert told.endswith("Its last line: libfoo.so.1: no such file")
    assert started.process.returncode == 1


def test_a_px4_that_does_not_start_is_reported(
    tmp_path: Path, settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[str] = []
    monkeypatch.setattr(room, "_START_WARNING_S", 0.1)
    hanging = SimpleNamespace(
        settings=settings,
        stopping=False,
        event=lambda text: (events.append(text), setattr(hanging, "stopping", True)),
    )
    with subprocess.Popen(["sleep", "60"], stdout=subprocess.PIPE) as process:
        assert room._watch(hanging, process, None) == 0
        process.kill()
    assert events == ["uav1: PX4 is not ready after 0.1 s. It has printed nothing"]


def test_a_stopped_px4_is_late_and_goes_on_when_continued(started: Started, world: World) -> None:
    until_ready(started, world)
    child = started.standin()
    child.suspend()
    world.until(lambda: world.status() == ["late"])
    assert started.process.poll() is None
    child.resume()
    world.until_in_step()
    assert any("replies again" in text for text in world.events) and not [
        t for t in started.receive() if "event" in t
    ]


def test_a_px4_that_stays_stopped_is_killed(
    tmp_path: Path, settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[str] = []
    monkeypatch.setattr(room, "_MAX_STOPPED_S", 0.1)
    given = SimpleNamespace(settings=settings, stopping=False, event=events.append, stats=events.append)
    with subprocess.Popen(["sleep", "60"], stdout=subprocess.PIPE) as process:
        process.send_signal(signal.SIGSTOP)
        assert room._watch(given, process, None) == 1
        assert process.poll() == -signal.SIGKILL
    assert (
        "(paused by a signal such as SIGSTOP for 0.1 s, then killed)" in events[0]
        and "paused by a signal" in events[1]["ended"]
    )


def test_px4_dies_with_its_killed_parent(started: Started, world: World) -> None:
    until_ready(started, world)
    child = started.standin()
    started.process.kill()
    world.until(lambda: not child.is_running() or child.status() == psutil.STATUS_ZOMBIE)


def test_a_second_stand_in_is_refused_by_the_lock(
    started: Started, world: World, settings: dict[str, Any]
) -> None:
    until_ready(started, world)
    folder = Path(settings["folder"])
    env = {**os.environ, **{f"PX4_PARAM_{k}": param_text(v) for k, v in settings["params"].items()}}
    argv = [*settings["argv"], "-d", "-i", "6", "-w", str(folder), str(folder / "etc")]
    second = subprocess.run(argv, env=env, capture_output=True, text=True, timeout=120, check=False)
    assert second.returncode == 1 and f"stand-in 6 at {world.address} is already running" in second.stderr


def test_px4_folder_links_all_but_the_arenas_scripts(tmp_path: Path, settings: dict[str, Any]) -> None:
    data = tmp_path / "etc"
    for name in (
        "init.d-posix/rcS",
        "init.d-posix/px4-rc.mavlink",
        "init.d-posix/airframes/1",
        "init.d/rc.mc",
        "extras.txt",
    ):
        (data / name).parent.mkdir(parents=True, exist_ok=True)
        (data / name).write_text("installed")
    folder = make_folder({**settings, "data": str(data)})
    etc = folder / "etc"
    for name in ("init.d-posix/rcS", "init.d-posix/airframes/1", "init.d/rc.mc", "extras.txt"):
        assert (etc / name).read_text() == "installed" and (etc / name).resolve() == data / name
    for name, content in settings["scripts"].items():
        written = etc / "init.d-posix" / name
        assert not written.is_symlink() and written.read_text() == content and os.access(written, os.X_OK)
    assert (data / "init.d-posix/px4-rc.mavlink").read_text() == "installed"


@pytest.mark.parametrize(
    ("value", "words"), [(4, "4"), (4.0, "4.0"), (0.25, "0.25"), (1_000_000, "1000000"), (-1, "-1")]
)
def test_a_parameter_is_formatted_by_its_type(value: float, words: str) -> None:
    assert param_text(value) == words


def with_free_ports(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the slice with free ports: the arenas of other tests use those of the rule."""
    links = {}
    for name, link in settings["links"].items():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("0.0.0.0", 0))
            links[name] = {**link, "local": [link["local"][0], free.getsockname()[1]]}
    return {**settings, "links": links}


@pytest.mark.parametrize("stand_in", [False, True])
def test_a_taken_link_port_is_an_error_with_its_holder(settings: dict[str, Any], stand_in: bool) -> None:
    given = {**with_free_ports(settings), "stand_in": stand_in}
    check_free(given)
    host, port = given["links"]["vision"]["local"]
    message = rf"the vision link's UDP port {port} is taken by process {os.getpid()} \(.+\) on {host}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind((host, port))
        with pytest.raises(RunError, match=message):
            check_free(given)


def test_only_a_held_instance_lock_is_an_error(
    settings: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "LOCK", str(tmp_path / "px4_lock-{instance}"))
    given = {**with_free_ports(settings), "stand_in": False}
    lock = tmp_path / "px4_lock-6"
    lock.touch()
    check_free(given)
    with lock.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(
            RunError, match="PX4 instance 6 is already running: stop it, or give this vehicle another id"
        ):
            check_free(given)
        check_free({**given, "stand_in": True})  # the stand-in has a lock of its own


ASK = """import os, sys
from arena.px4.__main__ import leave_core_of
leave_core_of(int(sys.argv[1]))
print(*sorted(os.sched_getaffinity(0)))"""
CORES = os.sched_getaffinity(0)


def left_by(world_cores: set[int]) -> set[int]:
    with subprocess.Popen(["sleep", "30"]) as world:
        try:
            os.sched_setaffinity(world.pid, world_cores)
            said = subprocess.run(
                [sys.executable, "-c", ASK, str(world.pid)], capture_output=True, text=True, check=True
            ).stdout
        finally:
            world.kill()
    return {int(core) for core in said.split()}


@pytest.mark.skipif(len(CORES) < 2, reason="one core")
def test_px4_leaves_the_core_of_a_world_that_keeps_one() -> None:
    core = max(CORES)
    assert left_by({core}) == CORES - {core}


def test_px4_uses_all_cores_when_the_world_does() -> None:
    assert left_by(CORES) == CORES
