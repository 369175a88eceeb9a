"""`arena up --detach`, ps, logs, restart and down, from other terminals."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from arena.plan.model import Listen, Plan
from arena.supervisor import active_runs, open_run

from .conftest import CHILDREN, eventually, is_running, plan_of, program, spec


class Terminal:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, str(CHILDREN / "arena_up.py"), *arguments]
        return subprocess.run(
            command, capture_output=True, text=True, timeout=120, cwd=self.folder, check=False
        )

    def up_and_wait(self, plan: Plan, *options: str) -> subprocess.CompletedProcess[str]:
        """Run `arena up` in the foreground until it ends."""
        (self.folder / "a.json").write_text(plan.to_json())
        return self.run("up", "a.json", "--until-done", *options)

    def up(self, plan: Plan, name: str = "a.json", *options: str) -> subprocess.CompletedProcess[str]:
        (self.folder / name).write_text(plan.to_json())
        return self.run("up", name, "--detach", *options)


@pytest.fixture
def terminal(tmp_path, runtime_dir):
    yield Terminal(tmp_path)
    for state in active_runs():
        assert Path(state.run).is_relative_to(tmp_path), f"not ours, not touched: {state.run}"
        os.kill(state.supervisor.pid, 15)
        eventually(lambda state=state: not state.live)
        raise AssertionError(f"still up: {state}")


def test_detached_arena_is_controlled_from_other_terminals(terminal):
    up = terminal.up(plan_of(spec("a", "good"), program("p", "sleeps", needs=("a",))))
    assert up.returncode == 0, up.stderr
    assert "arena down --run" in up.stdout
    shown = terminal.run("ps", "--json")
    assert shown.returncode == 0, shown.stderr
    status = json.loads(shown.stdout)
    assert {name: row["state"] for name, row in status["processes"].items()} == {"a": "READY", "p": "READY"}
    assert "READY" in terminal.run("ps").stdout
    assert f"pid {status['processes']['a']['pid']}" in terminal.run("logs", "a").stdout
    assert "there are logs of: a, p" in terminal.run("logs", "b").stderr
    assert terminal.run("restart", "a").returncode == 0
    eventually(lambda: json.loads(terminal.run("ps", "--json").stdout)["processes"]["a"]["starts"] == 2)
    assert "no process 'nobody'" in terminal.run("restart", "nobody").stderr
    down = terminal.run("down")
    assert down.returncode == 0 and "arena down: landing, then stopping" in down.stdout
    assert not is_running(status["processes"]["p"]["pid"]) and not is_running(status["pid"])
    assert "no arena is running" in terminal.run("ps").stderr


def test_detached_start_with_json_prints_one_object(terminal):
    up = terminal.up(plan_of(program("p", "sleeps")), "a.json", "--json")
    assert up.returncode == 0, up.stderr
    (line,) = up.stdout.splitlines()
    (run,) = active_runs()
    assert json.loads(line) == {"arena": "test", "supervisor": run.supervisor.pid, "run": str(run.run)}
    assert terminal.run("down").returncode == 0


def test_detached_start_reports_its_failure(terminal):
    up = terminal.up(
        plan_of(spec("a", "", kind="copilot", argv=("/no/such",)), program("p", "sleeps", needs=("a",)))
    )
    assert up.returncode == 1
    assert "could not start: /no/such" in up.stderr


def test_second_arena_needs_another_address(terminal):
    listens = (Listen(protocol="udp", address="127.53.0.1", port=5, what="x"),)
    assert terminal.up(plan_of(program("p", "sleeps", listens=listens))).returncode == 0
    second = terminal.up(plan_of(program("p", "sleeps", listens=listens), address="127.53.0.2"), "b.json")
    assert second.returncode == 1 and "the arena 'test' is running on 127.53.0.1" in second.stderr
    assert (
        terminal.up(plan_of(program("p", "sleeps"), address="127.53.0.2", name="other"), "b.json").returncode
        == 0
    )
    both = terminal.run("ps")
    assert both.returncode == 2 and both.stderr.count("--run") == 2
    for state in active_runs():
        assert terminal.run("down", "--run", state.run).returncode == 0


def test_up_sweeps_what_a_killed_supervisor_left(terminal):
    left = spec("left", "ignores_sigterm", outlives=True)
    terminal.up(plan_of(left))
    (state,) = active_runs()
    os.kill(state.supervisor.pid, 9)
    eventually(lambda: not state.live)
    assert "has died" in terminal.run("ps", "--run", state.run).stderr
    up = terminal.up(plan_of(program("p", "exits", "0")), "b.json", "--until-done")
    assert up.returncode == 0 and "has died; still running: left" in up.stdout
    assert not is_running(state.processes["left"].pid)
    eventually(lambda: not active_runs())


def test_broken_requests_get_an_error(terminal):
    terminal.up(plan_of(spec("a", "good")))
    (state,) = active_runs()
    for data in (
        b"{\n",
        b"[]\n",
        b'{"do": 3}\n',
        b"\xff\xfe\n",
        b"[" * 50_000 + b"\n",
        b'{"do": "restart"}\n',
        b"x" * 100_000,
    ):
        client = socket.socket(socket.AF_UNIX)
        client.settimeout(60)
        client.connect(f"{state.rt}/control.sock")
        client.sendall(data)
        assert b'"error"' in client.recv(4096), data[:20]
        client.close()
    deaf = socket.socket(socket.AF_UNIX)
    deaf.connect(f"{state.rt}/control.sock")
    deaf.setblocking(False)
    try:
        for _ in range(100_000):
            deaf.send(b'{"do": "ps"}\n')
    except OSError:
        pass
    assert terminal.run("ps").returncode == 0
    deaf.close()
    assert terminal.run("down", "--now").returncode == 0


def test_control_socket_and_folder_have_private_modes(terminal):
    terminal.up(plan_of(spec("a", "good")))
    (state,) = active_runs()
    assert Path(state.rt).stat().st_mode & 0o777 == 0o700
    assert Path(state.rt, "control.sock").stat().st_mode & 0o777 == 0o600
    assert terminal.run("down").returncode == 0


def test_arenas_of_another_runtime_folder_are_not_found(terminal, tmp_path, runtime_dir, monkeypatch):
    assert terminal.up(plan_of(spec("a", "good"))).returncode == 0
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(tmp_path / "elsewhere"))
    assert active_runs() == [] and terminal.run("down").returncode == 1
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(runtime_dir))
    assert len(active_runs()) == 1 and terminal.run("down").returncode == 0


def test_following_a_log_ends_with_the_run(terminal):
    terminal.up(plan_of(program("p", "exits", "0")), "a.json", "--until-done")
    (run,) = terminal.folder.glob("runs/*")
    eventually(lambda: open_run(run) is None)
    assert terminal.run("logs", "p", "-f", "--run", str(run)).stdout.startswith("pid ")


def test_up_prints_changes_and_a_verdict(terminal):
    up = terminal.up_and_wait(plan_of(spec("a", "good"), program("p", "exits", "0", needs=("a",))))
    lines = [line.partition(" s  ")[2] or line for line in up.stdout.splitlines()]
    assert up.returncode == 0 and lines[0].startswith("test: starting 2 processes, run folder ")
    assert "p: ended (exit 0)" in lines and not [line for line in lines if line.startswith("a: ")]
    assert lines[-2].startswith("test: succeeded after ") and lines[-1].startswith("run folder: ")


def test_up_verbose_prints_every_start_and_stop(terminal):
    up = terminal.up_and_wait(plan_of(spec("a", "good"), program("p", "exits", "0", needs=("a",))), "-v")
    for line in (
        "a: starting",
        "a: ready",
        "a: stopping (the run ends: done)",
        "a: ended: exit 0 (the run ends: done)",
    ):
        assert f" s  {line}\n" in up.stdout


def test_up_quiet_prints_failures_and_the_verdict_only(terminal):
    good = terminal.up_and_wait(plan_of(program("p", "exits", "0")), "-q")
    (line,) = good.stdout.splitlines()
    assert good.returncode == 0 and line.startswith("test: succeeded after ")
    bad = terminal.up_and_wait(plan_of(program("a", "", argv=("/no/such",))), "-q")
    assert bad.returncode == 1 and "a: failed (could not start: /no/such" in bad.stdout
    assert "test: FAILED after " in bad.stdout


def test_up_json_prints_one_object_per_line(terminal):
    up = terminal.up_and_wait(plan_of(program("p", "exits", "3")), "--json")
    *messages, result = map(json.loads, up.stdout.splitlines())
    assert up.returncode == result["exit_code"] == 1 and result["failed"] == ["p: exit 3"]
    assert "p" in {m["source"] for m in messages} and Path(result["run"]).is_dir()
