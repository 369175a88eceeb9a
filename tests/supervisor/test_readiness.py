"""Readiness of tools: a line of the output, a port, a file, a delay."""

from __future__ import annotations

import dataclasses
import os
import socket
import subprocess
import sys

import pytest

from arena.plan import make_plan
from arena.plan.model import Restart
from arena.schema import load_arena
from arena.supervisor.readiness import matching_line, proof

from .conftest import CHILDREN, Run, plan_of, program, spec


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def tool(tmp_path, kind: str, *rest: str, **changes):
    argv = (sys.executable, str(CHILDREN / "tool.py"), str(tmp_path / "go"), kind, *rest)
    given = {"argv": argv, "restart": Restart(), "start_timeout_s": 120.0, **changes}
    return spec("tool.t", "", **given)


CASES = {
    "log": lambda folder: (("agent is running",), {"ready": "log", "ready_value": r"agent .*running$"}),
    "file": lambda folder: ((str(folder / "made"),), {"ready": "file", "ready_value": str(folder / "made")}),
    "udp": lambda folder: _port(free_port(socket.SOCK_DGRAM)),
    "tcp": lambda folder: _port(free_port(socket.SOCK_STREAM)),
}


def _port(number: int):
    return (str(number),), {"ready": "port", "ready_port": number}


@pytest.mark.parametrize("kind", CASES)
def test_program_starts_when_its_tool_is_ready(start, tmp_path, kind):
    rest, changes = CASES[kind](tmp_path)
    made = plan_of(
        tool(tmp_path, kind, *rest, **changes),
        program("p", "exits", "0", needs=("tool.t",)),
        spec("a", "good"),
    )
    run: Run = start(made, "until_done")
    run.until("a", "READY")
    run.until("tool.t", "STARTING")
    assert not run.events("p")
    (tmp_path / "go").touch()
    assert run.wait() == 0
    (ready,) = [e["reason"] for e in run.events("tool.t") if e.get("to") == "READY"]
    assert ready.startswith({"log": "printed: agent is running", "file": "the file"}.get(kind, "serves port"))


def test_tool_that_is_never_ready_fails_and_its_program_does_not_start(start, tmp_path):
    never = tool(tmp_path, "log", "x", ready="log", ready_value="never", start_timeout_s=0.2)
    run = start(plan_of(never, program("p", "exits", "0", needs=("tool.t",))), "until_done")
    assert run.wait() == 1
    reasons = [e["reason"] for e in run.events("tool.t") if e.get("to") == "STOPPING"]
    assert reasons == ["not ready within 0.2 s"]
    assert "STARTING" not in [e.get("to") for e in run.events("p")]


def until_file(path) -> str:
    """Return a Python program that prints `up` and ends when a file exists."""
    return f"import pathlib,time\nprint('up', flush=True)\nwhile not pathlib.Path({str(path)!r}).exists(): time.sleep(0.02)"


def test_end_of_a_tool_that_a_program_needed_does_not_end_the_run(start, tmp_path):
    end, go = tmp_path / "end", tmp_path / "go"
    argv = (sys.executable, "-c", until_file(end))
    ends = spec("tool.t", "", argv=argv, ready="log", ready_value="up", restart=Restart())
    waits = program("p", "", argv=(sys.executable, "-c", until_file(go)), needs=("tool.t",))
    run = start(plan_of(ends, waits), "until_done")
    run.until("p", "READY")
    end.touch()
    run.until("tool.t", "EXITED")
    go.touch()
    assert run.wait() == 0


def test_agent_is_ready_when_it_serves_its_port(start, tmp_path):
    port = free_port(socket.SOCK_DGRAM)
    (tmp_path / "arena.yaml").write_text(
        f"vehicles: {{uav1: {{autopilot: builtin}}}}\ntools: {{microxrce: {{port: {port}}}}}\n"
    )
    (made,) = [
        p for p in make_plan(load_arena(tmp_path / "arena.yaml")).processes if p.name == "tool.microxrce"
    ]
    stand_in = tmp_path / "bin" / made.argv[0]
    stand_in.parent.mkdir()
    child = f"{sys.executable} {CHILDREN / 'xrce_agent.py'} {tmp_path / 'go'}"
    stand_in.write_text(f'#!/bin/sh\nexec {child} "$@"\n')
    stand_in.chmod(0o755)
    path = ("PATH", f"{stand_in.parent}:{os.environ['PATH']}")
    agent = dataclasses.replace(made, env=(*made.env, path), start_timeout_s=120.0)
    run = start(plan_of(agent, program("p", "exits", "0", needs=("tool.microxrce",))), "until_done")
    run.until("tool.microxrce", "STARTING")
    (tmp_path / "go").touch()
    assert run.wait() == 0
    assert f"serves port {port}" in [e["reason"] for e in run.events("tool.microxrce")]


def test_delay_is_over_after_its_time(tmp_path):
    delayed = spec("tool.t", "good", ready="delay", ready_value="2.5")
    given = {"pid": os.getpid(), "log": tmp_path / "x", "offset": 0, "reported": False}
    assert proof(delayed, alive_s=2.4, **given) == ""
    assert proof(delayed, alive_s=2.5, **given) == "ran for 2.5 s"


def test_lines_of_an_earlier_start_do_not_count(tmp_path):
    log = tmp_path / "log"
    log.write_text("ready\n")
    assert matching_line(log, 0, "^ready$") == "ready" and matching_line(log, 6, "^ready$") == ""
    log.write_text("ready\nstarting\n  ready \n")
    assert matching_line(log, 6, "ready") == "ready" and matching_line(tmp_path / "none", 0, "x") == ""


def test_port_of_another_process_is_no_proof(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        number = other.getsockname()[1]
        given = {"log": tmp_path / "x", "offset": 0, "alive_s": 1.0, "reported": False}
        served = spec("tool.t", "good", ready="port", ready_port=number)
        assert proof(served, pid=os.getpid(), **given) == f"serves port {number}"
        with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as stranger:
            assert proof(served, pid=stranger.pid, **given) == ""
            stranger.communicate()
