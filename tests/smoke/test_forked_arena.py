"""`arena up` that is forked behaves as one in a new interpreter, and so do the workers that fly scenarios."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from arena.smoke.flying import arena_up
from arena.smoke.flying.session import free_address
from arena.smoke.flying.workers import Lost, run_all
from arena.supervisor import proc_fs
from arena.supervisor.fork_client import ForkClient
from arena.supervisor.forked_child import ForkedChild

FACTS = """
import gc, json, os, sys

def seen(pid, file):
    return open(f"/proc/{pid}/{file}").read().rstrip("\\0").split("\\0")

def marks(pid):
    mine = ("ARENA_RUN=", "ARENA_PROCESS=", "ARENA_RUNTIME_DIR=")
    return sorted(x for x in seen(pid, "environ") if x.startswith(mine))

changing = ("ARENA_FD", "PYTEST_CURRENT_TEST")
up = os.getppid()
facts = {
    "up": [" ".join(seen(up, "cmdline")), os.getsid(up) == up, os.getpgid(up) == up, os.readlink(f"/proc/{up}/cwd"),
           os.readlink(f"/proc/{up}/fd/0"), marks(up), seen(up, "comm")],
    "argv": sys.argv, "orig": sys.orig_argv, "path": sys.path[0], "cwd": os.getcwd(), "seen": seen("self", "cmdline"),
    "env": {k: v for k, v in os.environ.items() if k not in changing}, "marks": marks("self"),
    "threshold": gc.get_threshold(), "hash": hash("arena") if "PYTHONHASHSEED" in os.environ else 0,
}
with open(os.path.join(os.path.dirname(__file__), "facts.json"), "w") as file:
    json.dump(facts, file)
"""
FLIES = """
from arena import UAV
with UAV.from_args() as uav:
    uav.start_offboard_mission()
    uav.set_pos_yaw(uav.ekf.pos + [0.0, 0.0, -0.5], 0.0, 2.0)
    uav.auto_land()
"""
Start = Callable[..., Any]
ENVIRONMENT = dict(os.environ)
"""Environment of both starts. That of this process can change in between, for example by an import."""


@pytest.fixture(scope="module")
def forks() -> Iterator[ForkClient]:
    client = ForkClient("flights")
    yield client
    client.close()


@pytest.fixture(params=["executed", "forked"])
def start(
    request: Any, forks: ForkClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Start]:
    """Return a function that starts `arena up` with arguments, and waits for nothing. `out` is the file of its output."""
    assert forks.wait_until_ready()
    monkeypatch.setattr(arena_up, "_forks", [forks] if request.param == "forked" else [])
    started = []

    def begin(*arguments: str, out: Path) -> Any:
        argv = [sys.executable, "-m", "arena.cli", "up", *arguments]
        env = {**ENVIRONMENT, "ARENA_RUNTIME_DIR": str(tmp_path / "rt")}
        started.append(arena_up.start(argv, env, out))
        assert isinstance(started[-1], ForkedChild) == (request.param == "forked")
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.wait()


def arena(folder: Path, program: str) -> Path:
    (folder / "flies.py").write_text(program)
    (folder / "rt").mkdir(exist_ok=True)
    text = "vehicles:\n  uav1: {autopilot: builtin, program: flies.py}\n"
    (folder / "arena.yaml").write_text(f"name: same\naddress: {free_address()}\n{text}")
    return folder / "arena.yaml"


_ALL: dict[str, Any] = {}


def same(name: str, found: Any) -> None:
    """Compare what two parameters of one test have found: the second call fails if it differs from the first."""
    assert _ALL.setdefault(name, found) == found


@pytest.mark.parametrize("arguments", [["--speed", "fast"], ["--help"], ["--no-such-option"], ["-q", "-v"]])
def test_wrong_options_give_the_same_output_and_exit_code(start: Start, tmp_path: Path, arguments: list[str]):
    file = arena(tmp_path, "")
    up = start(str(file), *arguments, out=tmp_path / "out")
    code = up.wait(60)
    same(f"options {arguments}", (code, (tmp_path / "out").read_text().replace(str(tmp_path), "")))
    assert code == (0 if arguments == ["--help"] else 2)


def test_flight_sees_and_does_the_same(start: Start, tmp_path: Path):
    facts, runs = tmp_path / "facts.json", tmp_path / "runs"
    file = arena(tmp_path, FACTS + FLIES)
    more = ("--headless", "--no-report", "--speed", "max", "--until-done", "--seed", "3", "--runs", str(runs))
    assert start(str(file), *more, out=tmp_path / "out").wait(120) == 0, (tmp_path / "out").read_text()
    (run,) = runs.iterdir()
    address = next(line.split()[1] for line in file.read_text().splitlines() if line.startswith("address"))
    seen = (
        facts.read_text().replace(run.name, "RUN").replace(str(tmp_path), "TMP").replace(address, "ADDRESS")
    )
    found = json.loads(seen)
    assert found["up"][0] == "arena:up same" and found["up"][1:3] == [True, True]
    # values that the arena adds, such as ports, can depend on other arenas: only their names are compared
    env = found.pop("env")
    same("environment", (sorted(env), {k: env.get(k) for k in ENVIRONMENT}))
    same("facts", found)
    same("flight", (run / "csv" / "uav1.csv").read_bytes())
    states = [
        (e["process"], e["to"])
        for e in map(json.loads, (run / "events.jsonl").read_text().splitlines())
        if "to" in e and e["process"] == "program.uav1"
    ]
    same("states", states)
    assert not list((tmp_path / "rt").iterdir())


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_signal_ends_the_arena_with_its_exit_code(start: Start, tmp_path: Path, number: int, code: int):
    runs = tmp_path / "runs"
    file = arena(tmp_path, "import signal\nsignal.pause()")
    up = start(
        str(file), "--headless", "--no-report", "--speed", "max", "--runs", str(runs), out=tmp_path / "out"
    )
    until(lambda: "processes ready" in (tmp_path / "out").read_text())
    up.send_signal(number)
    assert up.wait(60) == code, (tmp_path / "out").read_text()
    (run,) = runs.iterdir()
    assert json.loads((run / "outcome.json").read_text())["exit_code"] == code
    assert (run / "csv" / "uav1.csv").exists()


def test_killed_arena_leaves_no_process(start: Start, tmp_path: Path):
    file = arena(tmp_path, "import signal\nsignal.pause()")
    up = start(str(file), "--headless", "--no-report", "--speed", "max", out=tmp_path / "out")
    until(lambda: "processes ready" in (tmp_path / "out").read_text())
    mark = f"ARENA_RUNTIME_DIR={tmp_path / 'rt'}"
    assert [pid for pid in running(mark) if pid != up.pid]
    up.kill()
    assert up.wait(60) == -signal.SIGKILL
    until(lambda: not running(mark))


def running(mark: str) -> list[int]:
    pids = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    return [pid for pid in pids if mark in proc_fs.environment(pid) and not proc_fs.is_zombie(pid)]


def until(check: Callable[[], Any]) -> None:
    deadline = time.monotonic() + 120.0
    while not check():
        assert time.monotonic() < deadline
        time.sleep(0.02)


# -- workers


def test_forked_workers_send_results_and_ends(forks: ForkClient):
    ended: dict[Any, Any] = {}
    run_all([4.0, 9.0, "x"], math.sqrt, jobs=2, on_end=ended.__setitem__, forks=forks)
    assert ended[4.0] == 2.0 and ended[9.0] == 3.0
    assert isinstance(ended["x"], Lost) and ended["x"].exit_code == 1
    run_all([7], os._exit, jobs=1, on_end=ended.__setitem__, forks=forks)
    assert ended[7] == Lost(exit_code=7)


def test_worker_has_a_session_of_its_own(forks: ForkClient):
    sessions: dict[int, Any] = {}
    run_all([0], os.getsid, jobs=1, on_end=sessions.__setitem__, forks=forks)
    assert sessions[0] not in (os.getsid(0), 0)


def own_cores(_: int) -> set[int]:
    return os.sched_getaffinity(0)


def test_as_many_workers_as_cores_keep_to_one_core_each():
    everywhere, found = os.sched_getaffinity(0), dict[int, Any]()
    run_all(range(len(everywhere)), own_cores, jobs=len(everywhere), on_end=found.__setitem__)
    assert sorted(map(list, found.values())) == sorted([core] for core in everywhere)


def test_fewer_workers_use_all_cores_and_so_does_a_forked_one(forks: ForkClient):
    everywhere, found = os.sched_getaffinity(0), dict[int, Any]()
    if len(everywhere) == 1:
        pytest.skip("this machine has one core")
    run_all([0, 1, 2], own_cores, jobs=1, on_end=found.__setitem__)
    assert list(found.values()) == [everywhere] * 3
    run_all([0], os.sched_getaffinity, jobs=8, on_end=found.__setitem__, forks=forks)
    assert found[0] == everywhere


def test_worker_ends_when_the_runner_dies(tmp_path: Path):
    task = f"import os, time; open({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid())); time.sleep(600)"
    code = (
        "import sys\nfrom arena.supervisor.fork_client import ForkClient\nfrom arena.smoke.flying.workers import run_all\n"
        "run_all([sys.argv[1]], exec, jobs=1, on_end=print, forks=ForkClient('flights'))"
    )
    runner = subprocess.Popen([sys.executable, "-c", code, task])
    until(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
    pid = int((tmp_path / "pid").read_text())
    runner.kill()
    runner.wait()
    until(lambda: proc_fs.start_time(pid) is None or proc_fs.is_zombie(pid))
