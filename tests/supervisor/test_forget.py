"""`arena forget`: an operator declares a real vehicle dead, and the run does not wait for it."""  # review fault 18

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace

import pytest

from arena.errors import RunError

from .conftest import Run, eventually, plan_of, program, spec, vehicle

SILENT = {"uav1.connected": False, "uav1.armed": True, "uav1.mode": "OFFBOARD"}


def plan_with(*more, facts=SILENT, simulated=False):
    """A plan whose router reports `facts` about uav1; the land task never confirms a landing."""
    return plan_of(
        spec("router", "world", json.dumps(facts), kind="router", outlives=True),
        program("p", "sleeps", needs=("router",)),
        *more,
        vehicles=(vehicle(simulated=simulated),),
        land=spec("land", "dies_at_once", kind="task"),
    )


def begin(start, plan) -> Run:
    run = start(plan)
    run.until("p", "READY")
    eventually(lambda: "uav1.armed" in run.control().ask(do="ps")["facts"])
    return run


def arena(*arguments: str, answer: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "arena.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, input=answer, timeout=120, check=False)


def test_run_ends_without_a_vehicle_declared_dead(start):
    run = begin(start, plan_with())
    run.signal(signal.SIGINT)
    eventually(lambda: run.log("land").count("pid") >= 2, what="the landing is repeated")
    done = arena("forget", "uav1", "--yes", "--run", str(run.folder))
    assert done.returncode == 0, done.stderr
    assert run.wait() == 130
    assert " has declared this vehicle dead; the end of the run" in run.said()
    assert re.search("the landing does not wait for uav1: .+ has declared this vehicle dead", run.said())


def test_until_done_does_not_wait_for_a_vehicle_declared_dead(start):
    plan = plan_of(
        spec("router", "world", json.dumps(SILENT), kind="router"),
        program("p", "exits", "0", needs=("router",)),
        vehicles=(vehicle(simulated=False),),
    )
    run = start(plan, "until_done")
    run.until("p", "EXITED")
    run.control().ask(do="forget", vehicle="uav1", by="the tester")
    assert run.wait() == 0
    assert "uav1: the tester has declared this vehicle dead" in run.said()


def test_unplugged_board_in_the_loop_can_be_declared_dead(start):
    plan = plan_of(
        spec("router", "world", json.dumps(SILENT), kind="router"),
        program("p", "exits", "0", needs=("router",)),
        vehicles=(replace(vehicle(), autopilot="hitl"),),
    )
    run = start(plan, "until_done")
    run.until("p", "EXITED")
    run.control().ask(do="forget", vehicle="uav1", by="the tester")
    assert run.wait() == 0


def test_armed_vehicle_with_telemetry_is_not_declared_dead(start):
    run = begin(start, plan_with(facts={**SILENT, "uav1.connected": True}))
    done = arena("forget", "uav1", "--yes", "--run", str(run.folder))
    assert done.returncode == 1
    assert "uav1 cannot be declared dead: it is armed and sends telemetry" in done.stderr
    assert "arena kill-all --only uav1" in done.stderr
    run.end()


@pytest.mark.parametrize(("name", "simulated"), [("uav1", True), ("uav9", False)])
def test_only_a_real_vehicle_can_be_declared_dead(start, name, simulated):
    run = begin(start, plan_with(simulated=simulated))
    with pytest.raises(RunError, match="only a real vehicle can be declared dead: got '"):
        run.control().ask(do="forget", vehicle=name, by="the tester")
    run.end()


def test_forget_needs_a_confirmation(start):
    run = begin(start, plan_with())
    done = arena("forget", "uav1", "--run", str(run.folder))
    assert done.returncode == 2 and "use a terminal, or add --yes" in done.stderr
    assert "uav1 was last reported as armed (telemetry: none arrives now)." in done.stdout
    run.end()


def test_run_waits_again_for_a_vehicle_that_returns(start, tmp_path):
    flag = tmp_path / "armed"
    plan = plan_of(
        spec("router", "reports_arming", str(flag), kind="router", outlives=True),
        program("p", "sleeps", needs=("router",)),
        vehicles=(vehicle(simulated=False),),
        land=spec("land", "disarms", str(flag), kind="task"),
    )
    run = begin(start, plan)
    run.control().ask(do="forget", vehicle="uav1", by="the tester")
    flag.touch()
    run.until_said("but it sends telemetry and is armed: the run waits for it again")
    os.kill(run.process.pid, signal.SIGTERM)
    assert run.wait() == 0
    assert "landed all" in run.log("land")
