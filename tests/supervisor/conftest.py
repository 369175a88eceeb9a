"""Plans made by hand, runs of them under the real supervisor, and a check that no process survives a test."""

from __future__ import annotations

import contextlib
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
LIMIT_S = 120.0
"""Limit of every wait [s]. Tests wait for events, so it matters on a starved machine only."""


def eventually(check: Callable[[], Any], limit_s: float = LIMIT_S, what: str = "") -> Any:
    """Return the first true value of `check`; fail at the deadline."""
    deadline = time.monotonic() + limit_s
    while time.monotonic() < deadline:
        if value := check():
            return value
        time.sleep(0.02)
    raise AssertionError(f"not within {limit_s} s: {what or check}")


def spec(name: str, kind_of_child: str, *arguments: str, **changes: Any) -> ProcessSpec:
    given: dict[str, Any] = {
        "name": name,
        "kind": "tool",
        "argv": (sys.executable, "-S", str(CHILDREN / "misfit.py"), kind_of_child, *arguments),
        "stop_timeout_s": 0.3 if kind_of_child == "ignores_sigterm" else 30.0,
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
        mocap_body=name,
    )


def plan_of(*processes: ProcessSpec, **changes: Any) -> Plan:
    return Plan(
        **{"name": "test", "address": "127.53.0.1", "vehicles": (), "processes": processes, **changes}
    )


class Run:
    """A supervisor in a process of its own. `end` kills and returns every process that it has left."""

    def __init__(
        self, folder: Path, plan: Plan, *options: str, runs: Path | None = None, **popen: Any
    ) -> None:
        self.runs = runs or folder / "runs"
        self._folder: Path | None = None
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
        if self._folder is None:
            self._folder = eventually(lambda: next(iter(self.runs.glob("*")), None), what="a run folder")
        return self._folder

    @property
    def state(self) -> RunState:
        return eventually(lambda: open_run(self.folder), what="state.json")

    @property
    def outcome(self) -> dict[str, Any]:
        return json.loads((self.folder / "outcome.json").read_text())

    def events(self, process: str = "") -> list[dict[str, Any]]:
        file = self.folder / "events.jsonl"
        whole = file.read_text().rpartition("\n")[0] if file.exists() else ""  # it may be about to be written
        return [e for e in map(json.loads, whole.splitlines()) if process in ("", e["process"])]

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

    def wait(self, limit_s: float = LIMIT_S) -> int:
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
        """Return the processes of this run that still run. The environment identifies them: a pid may have been reused."""
        found = {
            pid for sid in self.sessions() for pid in {sid, *proc_fs.session_members(sid)} if is_running(pid)
        }
        return {pid for pid in found if f"ARENA_RUN={self.folder}" in proc_fs.environment(pid)}

    def end(self) -> set[int]:
        """Kill what is left of the run. Return the pids that had to be killed."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        left = self.survivors()
        for pid in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        eventually(lambda: not any(map(is_running, left)), what="end of the killed processes")
        return left


def is_running(pid: int) -> bool:
    return proc_fs.start_time(pid) is not None and not proc_fs.is_zombie(pid)


@pytest.fixture
def start(tmp_path: Path, runtime_dir: Path) -> Iterator[Callable[..., Run]]:
    """start(plan, *options) -> Run. Fails the test when a process of it is left."""
    runs: list[Run] = []

    def begin(plan: Plan, *options: str, folder: Path | None = None, **popen: Any) -> Run:
        own = tmp_path / f"run{len(runs)}" if runs else tmp_path
        runs.append(Run(tmp_path, plan, *options, runs=(folder or own) / "runs", **popen))
        return runs[-1]

    yield begin
    left = [run.end() for run in runs]
    assert not any(left), f"still running after the test: {left}"
