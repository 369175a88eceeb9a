"""Actions become signals, commands and faults."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from arena.errors import RunError
from arena.fault_injection import FaultReceiver
from arena.plan import Plan
from arena.smoke.flying.actions import ActionRunner, faults
from arena.smoke.flying.run_log import RunLog
from arena.smoke.language.model import Action, Place
from arena.smoke.language.vocabulary import ACTIONS
from arena.supervisor import RunFolder, proc_fs
from arena.supervisor.run_folder import Member, myself

PLACE = Place(file="x", line=1, text="")


def action(verb: Any, **more: Any) -> Action:
    return Action(verb=verb, place=PLACE, **more)


@pytest.fixture
def run(plan: Plan, tmp_path: Path) -> RunFolder:
    """A run folder of an arena that does not run; the slices name sockets for faults."""
    folder = RunFolder(path=tmp_path / "run", rt=tmp_path / "rt")
    for made in (folder.path / "slices", folder.path / "logs", folder.rt):
        made.mkdir(parents=True)
    for room in ("world", "mocap", "router"):
        given = {**plan.slices[f"{room}.json"], "faults": str(folder.rt / f"{room}.faults")}
        (folder.path / "slices" / f"{room}.json").write_text(json.dumps(given))
    return folder


def runner_of(plan: Plan, run: RunFolder) -> ActionRunner:
    listener: Any = SimpleNamespace(command=lambda *_: None, set_parameter=lambda *_: None)
    return ActionRunner(plan, run.path, run.rt, RunLog(run.path, []), listener)


FAULTS_OF_ACTIONS = [
    (action("mocap dropout", vehicles=("uav1",)), "mocap", {"do": "dropout", "body": "red", "on": True}),
    (
        action("mocap swap", vehicles=("uav1", "uav2")),
        "mocap",
        {"do": "swap", "bodies": ["red", "blue"], "on": True},
    ),
    (
        action("mocap jump", vehicles=("uav2",), by=(1.0, 0.0, 0.5)),
        "mocap",
        {"do": "jump", "body": "blue", "by_m": [1.0, 0.0, 0.5], "yaw_deg": 0.0},
    ),
    (action("mocap delay", number=200.0), "mocap", {"do": "delay", "ms": 200.0}),
    (
        action("link loss", vehicles=("uav1",), number=0.3),
        "router",
        {"do": "loss", "vehicle": "uav1", "share": 0.3},
    ),
    (action("ground station loss"), "router", {"do": "heartbeat", "on": False}),
    (action("ground station loss", undo=True), "router", {"do": "heartbeat", "on": True}),
    (action("rc loss", vehicles=("uav1",)), "world", {"do": "sticks", "vehicle": "uav1", "on": False}),
    (
        action("motor loss", vehicles=("uav1",), number=2.0),
        "world",
        {"do": "motor", "vehicle": "uav1", "rotor": 2, "thrust": 0.0},
    ),
    (
        action("battery drain", vehicles=("uav1",), number=20.0, undo=True),
        "world",
        {"do": "battery", "vehicle": "uav1", "empty_in_s": None},
    ),
    (action("wind", by=(3.0, 0.0, 0.0)), "world", {"do": "wind", "wind_m_s": [3.0, 0.0, 0.0]}),
]


@pytest.mark.parametrize(
    ("given", "room", "expected"), FAULTS_OF_ACTIONS, ids=lambda x: getattr(x, "verb", None)
)
def test_fault_is_sent_to_its_process(
    plan: Plan, run: RunFolder, given: Action, room: str, expected: dict[str, Any]
):
    listening = FaultReceiver(run.rt / f"{room}.faults")
    runner_of(plan, run).do(given)
    assert listening.take() == [expected]
    listening.close()


@pytest.mark.parametrize("form", [f for f in ACTIONS if f.lasting and f.verb != "hang"], ids=lambda f: f.verb)
def test_every_lasting_action_is_a_fault_that_can_be_undone(plan: Plan, form: Any):
    given = action(form.verb, vehicles=("uav1", "uav2"), number=1.0, by=(1.0, 2.0, 3.0), for_s=1.0)
    by_name, world = {v.name: v for v in plan.vehicles}, plan.slices["world.json"]
    done, undone = faults(given, by_name, world), faults(replace(given, undo=True), by_name, world)
    assert done and [room for room, _ in done] == [room for room, _ in undone]
    assert all(a != b and a["do"] == b["do"] for (_, a), (_, b) in zip(done, undone, strict=True))


def test_process_without_a_fault_socket_is_an_error(plan: Plan, run: RunFolder):
    with pytest.raises(RunError, match="no process receives faults"):
        runner_of(plan, run).do(action("wind"))


def test_signals_reach_only_the_recorded_process(plan: Plan, run: RunFolder):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
    try:
        member = Member(pid=child.pid, pgid=child.pid, start_s=proc_fs.start_time(child.pid) or 0.0)
        run.write_state(plan, {"router": replace(member, start_s=member.start_s - 1.0)})
        with pytest.raises(RunError, match="cannot kill router: this process has ended"):
            runner_of(plan, run).do(action("kill", processes=("router",)))
        run.write_state(plan, {"router": member})
        hand = runner_of(plan, run)
        hand.do(action("hang", processes=("router",)))
        _, status = os.waitpid(child.pid, os.WUNTRACED)
        assert os.WIFSTOPPED(status)
        hand.do(action("kill", processes=("router",)))
        assert child.wait(20) == -signal.SIGKILL
        with pytest.raises(RunError, match="cannot resume router: this process has ended"):
            hand.do(action("resume", processes=("router",)))
        hand.do(
            action("hang", processes=("router",), undo=True)
        )  # undoing it is no error: the process has ended meanwhile
    finally:
        child.kill()
        child.wait()


def test_restart_needs_the_supervisor(plan: Plan, run: RunFolder):
    run.write_state(plan, {})
    assert runner_of(plan, run)._run_log.member("supervisor") == myself()
    with pytest.raises(RunError, match="no arena replies"):
        runner_of(plan, run).do(action("restart", processes=("router",)))
