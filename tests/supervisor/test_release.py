"""`arena release`: refused when nothing is to release, else sent to the processes that pass commands to the vehicle."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

import pytest

from arena.errors import RunError
from arena.plan.model import Restart
from arena.supervisor.release import check_release, guards, restore_requests

from .conftest import eventually, plan_of, spec, vehicle

BLOCKED = {"uav1.armed": False, "uav1.control": "", "uav1.blocked": "land-all has control"}
FREE = {**BLOCKED, "uav1.blocked": "", "uav1.control": "program"}


def plan():
    kinds = {"world": "world", "router": "router", "link.uav1": "link", "link.uav2": "link", "mocap": "mocap"}
    processes = [
        spec(name, "good", kind=kind, vehicle=name.partition(".")[2] or None) for name, kind in kinds.items()
    ]
    return plan_of(*processes, vehicles=(vehicle(), vehicle("uav2", simulated=False)))


def test_release_goes_to_the_processes_that_pass_commands_to_the_vehicle():
    assert guards(plan(), "uav1") == {"world", "router", "link.uav1"}
    assert guards(plan()) == {"world", "router", "link.uav1", "link.uav2"}


IN_WORLD = {"world": {"autopilot": {"uav1": {"blocked": "land-all has control"}}}}


@pytest.mark.parametrize(
    ("facts", "stats"),
    [(BLOCKED, {}), ({}, {}), ({**FREE, "uav1.blocked_at_link": "pilot took control"}, {}), (FREE, IN_WORLD)],
    ids=["at the router", "unknown", "at the link", "in the world"],
)
def test_blocked_vehicle_may_be_released(facts, stats):
    check_release(plan(), facts, stats, ["uav1"])


@pytest.mark.parametrize(
    ("vehicles", "words"),
    [
        (
            ["uav1"],
            "uav1: no release is needed: programs are already allowed to command this vehicle .control: program",
        ),
        (["uav9"], "got vehicle 'uav9', expected one of uav1, uav2"),
        ([], "got no vehicle, expected at least one of uav1, uav2"),
    ],
)
def test_release_is_refused_with_its_reason(vehicles, words):
    with pytest.raises(ValueError, match=words):
        check_release(plan(), FREE, {}, vehicles)


def begin(start, *names: str):
    """Start processes that report uav1 as blocked, and a process that keeps the run in its end. Return the run."""
    kinds = {"link.uav1": "link"}
    reporting = [
        spec(name, "prints_requests", json.dumps(BLOCKED), kind=kinds.get(name, name), stopped_for_s=None)
        for name in names
    ]
    run = start(plan_of(*reporting, spec("n", "ignores_sigterm"), vehicles=(vehicle(),)))
    eventually(lambda: "uav1.blocked" in run.control().ask(do="ps")["facts"])
    for name in names:
        run.until(name, "READY")
    return run


def requests(run, name):
    """Return the releases that a process has received."""
    lines = [line for line in run.log(name).splitlines() if line.startswith("{")]
    return [request for request in map(json.loads, lines) if request["do"] == "release"]


def release(run):
    command = [sys.executable, "-m", "arena.cli", "release", "uav1", "--run", str(run.folder)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_release_reaches_the_router_and_is_refused_at_the_end(start):
    run = begin(start, "router")
    done = release(run)
    assert (done.returncode, done.stdout) == (
        0,
        "uav1: released; programs are allowed to arm and fly again\n",
    ), done.stderr
    (packet,) = requests(run, "router")
    assert packet["vehicle"] == "uav1" and packet["id"] and packet["expires"] > 0.0
    with pytest.raises(RunError, match="uav9"):
        run.control().ask(do="release", vehicles=["uav9"], by="ada")
    run.signal(signal.SIGTERM)
    run.wait()
    assert '{"do": "refuse_arming", "why": "the run is ending"}' in run.log("router")  # review fault 6


@pytest.mark.parametrize(("paused", "other"), [("link.uav1", "router"), ("router", "link.uav1")])
def test_release_names_the_process_that_does_not_confirm(start, paused, other):
    run = begin(start, "link.uav1", "router")
    os.kill(run.pid(paused), signal.SIGSTOP)
    done = release(run)
    assert done.returncode == 1 and "released; programs are allowed to" not in done.stdout
    assert f"uav1: NOT released: {paused}" in done.stderr and "did not confirm within 3 s" in done.stderr
    assert requests(run, "router") == []  # the router refuses the programs until the link has confirmed
    os.kill(run.pid(paused), signal.SIGCONT)
    eventually(lambda: release(run).returncode == 0, what="a second release")
    assert requests(run, other)
    run.signal(signal.SIGTERM)
    run.wait()


def test_nothing_is_released_while_a_process_does_not_run(start):
    router = spec("router", "prints_requests", json.dumps(BLOCKED), kind="router")
    link = spec("link.uav1", "dies_at_once", kind="link", restart=Restart(mode="never"))
    run = start(plan_of(router, link, vehicles=(vehicle(),)))
    run.until("router", "READY")
    eventually(lambda: run.events("link.uav1") and "link.uav1" not in run.state.processes)
    done = release(run)
    assert done.returncode == 1 and "because these processes do not run: link.uav1. Repeat" in done.stderr
    assert requests(run, "router") == []
    run.signal(signal.SIGTERM)
    run.wait()


STANDING = {"latch": [4, 3]}


def test_restarted_process_gets_what_all_processes_enforced_before():
    facts = {"uav1.standing": STANDING, "uav2.standing": {}, "uav2.standing_at_link": {"pilot": True}}
    specs = {s.name: s for s in plan().processes}
    of_uav1 = {"do": "restore", "vehicle": "uav1", "standing": STANDING}
    of_uav2 = {"do": "restore", "vehicle": "uav2", "standing": {"pilot": True}}
    assert restore_requests(plan(), specs["router"], facts) == [of_uav1, of_uav2]
    assert restore_requests(plan(), specs["link.uav2"], facts) == [of_uav2]
    assert restore_requests(plan(), specs["mocap"], facts) == []


def test_restarted_link_learns_that_its_vehicle_was_armed():
    specs = {s.name: s for s in plan().processes}
    facts = {"uav1.armed": True, "uav2.armed": True}
    assert restore_requests(plan(), specs["link.uav2"], facts) == [{"do": "was_armed", "vehicle": "uav2"}]
    assert restore_requests(plan(), specs["link.uav2"], {"uav2.armed": False}) == []
    assert restore_requests(plan(), specs["router"], facts) == []


def test_killed_router_gets_its_standing_state_before_any_other_request(start):
    facts = json.dumps({**BLOCKED, "uav1.standing": STANDING})
    router = spec(
        "router", "prints_requests", facts, kind="router", restart=Restart(mode="on_failure", backoff_s=0.05)
    )
    run = start(plan_of(router, vehicles=(vehicle(),)))
    eventually(lambda: "uav1.standing" in run.control().ask(do="ps")["facts"])
    assert "restore" not in run.log("router")
    os.kill(run.state.processes["router"].pid, signal.SIGKILL)
    run.until("router", "READY", times=2)
    eventually(
        lambda: '{"do": "restore", "vehicle": "uav1", "standing": {"latch": [4, 3]}}' in run.log("router")
    )
    run.signal(signal.SIGTERM)
    run.wait()
