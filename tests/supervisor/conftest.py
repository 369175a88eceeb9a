"""Plans made by hand, runs under the real supervisor, and the proof that nothing of them survives."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from arena.plan.model import LinkPlan, Plan, ProcessSpec, Restart, VehiclePlan
from arena.supervisor import Control, RunState, open_run, proc_fs

CHILDREN = Path(__file__).parents[1] / "children"


def eventually(check: Callable[[], Any], limit_s: float = 40.0, what: str = "") -> Any:
    """The first true value of `check`; fails at the deadline."""
    deadline = time.monotonic() + limit_s  # generous: the machine may be shared
    while time.monotonic() < deadline:
        if value := check():
            return value
        time.sleep(0.02)
    raise AssertionError(f"not within {limit_s} s: {what or check}")


def spec(name: str, kind_of_child: str, *arguments: str, **changes: Any) -> ProcessSpec:
    given: dict[str, Any] = {
        "name": name,
        "kind": "tool",
        "argv": (sys.executable, str(CHILDREN / "misfit.py"), kind_of_child, *arguments),
        "stop_timeout_s": 1.0,
        "restart": Restart(backoff_s=0.05, limit=3),
    }
    return ProcessSpec(**{**given, **changes})


def program(name: str, kind_of_child: str, *arguments: str, **changes: Any) -> ProcessSpec:
    return spec(name, kind_of_child, *arguments, **{"kind": "program", "ready": "started", **changes})


def world(*arguments: str, **changes: Any) -> ProcessSpec:
    return spec("world", "world", *arguments, **{"kind": "world", "outlives": True, **changes})


def vehicle(name: str = "uav1", simulated: bool = True) -> VehiclePlan:
    link = LinkPlan(autopilot_host="127.53.0.1", autopilot_port=1, partner_host="127.53.0.1", partner_port=2)
    return VehiclePlan(
        name=name,
        id=1,
        autopilot="builtin",
        profile="iris",
        simulated=simulated,
        router=link,
        vision=link,
        panic=link,
        port=3,
        sdk_port=4,
        tools_port=5,
        logger_port=6,
        mocap_body=name,
    )


def plan_of(*processes: ProcessSpec, **changes: Any) -> Plan:
    return Plan(
        **{"name": "test", "address": "127.53.0.1", "vehicles": (), "processes": processes, **changes}
    )


class Run:
    """One supervisor in a process of its own. Everything that it ever started is recorded, to be looked for at the end."""

    def __init__(self, folder: Path, plan: Plan, *options: str, **popen: Any) -> None:
        self.runs = folder / "runs"
        (folder / "plan.json").write_text(plan.to_json())
        command = [
            sys.executable,
            str(CHILDREN / "supervised.py"),
            str(folder / "plan.json"),
            str(self.runs),
            *options,
        ]
        self.out = folder / "out.txt"
        with self.out.open("wb") as out:
            self.process = subprocess.Popen(
                command, start_new_session=True, **{"stdout": out, "stderr": subprocess.STDOUT, **popen}
            )

    @property
    def folder(self) -> Path:
        return eventually(lambda: next(iter(self.runs.glob("*")), None), what="a run folder")

    @property
    def state(self) -> RunState:
        return eventually(lambda: open_run(self.folder), what="state.json")

    @property
    def outcome(self) -> dict[str, Any]:
        return json.loads((self.folder / "outcome.json").read_text())

    def events(self, process: str = "") -> list[dict[str, Any]]:
        file = self.folder / "events.jsonl"
        lines = file.read_text().splitlines() if file.exists() else []
        return [e for e in map(json.loads, lines) if process in ("", e["process"])]

    def until(self, process: str, state: str, times: int = 1) -> dict[str, Any]:
        """Wait for a transition of a process into a state."""

        def found() -> list[dict[str, Any]]:
            return [e for e in self.events(process) if e.get("to") == state]

        return eventually(
            lambda: len(found()) >= times and found()[times - 1], what=f"{process} {state}, {self.said()}"
        )

    def until_said(self, words: str) -> None:
        eventually(lambda: words in self.said(), what=f"{words!r} in {self.said()}")

    def said(self) -> str:
        return self.out.read_text(errors="replace")

    def log(self, name: str) -> str:
        file = self.folder / "logs" / f"{name}.log"
        return file.read_text(errors="replace") if file.exists() else ""

    def pid(self, name: str) -> int:
        return eventually(
            lambda: self.log(name).startswith("pid ") and int(self.log(name).split()[1]),
            what=f"pid of {name}",
        )

    def control(self) -> Control:
        eventually(lambda: Path(self.state.rt, "control.sock").exists())
        return Control(Path(self.state.rt, "control.sock"))

    def signal(self, number: int) -> None:
        self.process.send_signal(number)

    def wait(self, limit_s: float = 15.0) -> int:
        return self.process.wait(limit_s)

    def sessions(self) -> set[int]:
        logs = list(self.folder.glob("logs/*.log")) if self.runs.exists() and any(self.runs.iterdir()) else []
        words = [
            line.split()
            for log in logs
            for line in log.read_bytes()[:10000].decode(errors="replace").splitlines()
        ]
        return {int(w[1]) for w in words if len(w) == 2 and w[0] in ("pid", "grandchild") and w[1].isdigit()}

    def survivors(self) -> set[int]:
        """By what they were started with: a number read from a log may belong to a stranger by now."""
        found = {
            pid for sid in self.sessions() for pid in {sid, *proc_fs.session_members(sid)} if is_running(pid)
        }
        return {pid for pid in found if f"ARENA_RUN={self.folder}" in proc_fs.environment(pid)}

    def end(self) -> set[int]:
        """After the test: nothing of it lives on. Returns what had to be killed."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        left = self.survivors()
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        return left


def is_running(pid: int) -> bool:
    return proc_fs.start_time(pid) is not None and not proc_fs.is_zombie(pid)


@pytest.fixture
def start(tmp_path: Path, runtime_dir: Path) -> Iterator[Callable[..., Run]]:
    """start(plan, *options) -> Run. After a test nothing that it started may be running."""
    runs: list[Run] = []

    def begin(plan: Plan, *options: str, **popen: Any) -> Run:
        runs.append(Run(tmp_path, plan, *options, **popen))
        return runs[-1]

    yield begin
    left = [run.end() for run in runs]
    assert not any(left), f"still running after the test: {left}"
