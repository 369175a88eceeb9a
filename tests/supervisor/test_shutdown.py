"""Landed is an invariant: a vehicle that becomes armed while the arena stops is landed again, and stays served meanwhile."""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest

from arena.errors import RunError
from arena.plan.model import Restart

from .conftest import Run, eventually, is_running, plan_of, program, spec, vehicle

RESTARTED = Restart(mode="on_failure", backoff_s=0.05)


def armed_by(
    flag: Path,
    *more,
    program_kind="sleeps",
    landing="disarms",
    land_argument=None,
    land_task=None,
    router_ends_after_s=0.0,
    **changes,
):
    """A plan with one real vehicle, which is armed while the file `flag` exists; the land task deletes the file."""
    return plan_of(
        spec(
            "router",
            "reports_arming",
            str(flag),
            str(router_ends_after_s),
            kind="router",
            outlives=True,
            restart=RESTARTED,
        ),
        program("p", program_kind, str(flag), needs=("router",)),
        *more,
        vehicles=(vehicle(simulated=False),),
        land=land_task or spec("land", landing, str(land_argument or flag), kind="task"),
        **changes,
    )


def begin(start, plan, *, armed: bool = True, **where) -> Run:
    run = start(plan, **where)
    run.until("p", "READY")
    eventually(lambda: "arms_at_its_end" not in " ".join(plan.processes[1].argv) or "flies" in run.log("p"))
    eventually(lambda: run.control().ask(do="ps")["facts"].get("uav1.armed") is armed)
    return run


def test_vehicle_armed_by_a_dying_program_is_landed_again(start, tmp_path):  # review fault 6
    flag = tmp_path / "armed"
    run = begin(start, armed_by(flag, program_kind="arms_at_its_end"), armed=False)
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert "uav1 was armed while the arena was stopping: landing again" in run.said()
    assert "landed all" in run.log("land") and not flag.exists()
    assert "ended while the vehicle is disarmed" in run.log("router")
    assert run.outcome["landing"] == "landed and disarmed"


def test_router_ends_after_the_last_program(start, tmp_path):  # review fault 6
    """Also with `arena down --now`: a program that dies may have armed the vehicle just before."""
    run = begin(start, armed_by(tmp_path / "armed", program_kind="arms_at_its_end"), armed=False)
    run.control().ask(do="down", now=True)
    assert run.wait() == 0
    order = [(e["process"], e["to"]) for e in run.events() if e.get("to") in ("STOPPING", "EXITED")]
    assert order.index(("p", "EXITED")) < order.index(("router", "STOPPING"))


@pytest.mark.parametrize("router_ends_after_s", [0.0, 1.0])
def test_process_that_serves_an_armed_vehicle_is_not_killed(
    start, tmp_path, router_ends_after_s
):  # review fault 6
    """The pilot arms by radio when the link receives its stop signal. The router is started again for the landing.

    A router that ends late still reports the vehicle as disarmed then.
    """
    by_radio, go = tmp_path / "armed by radio", tmp_path / "go"
    link = spec(
        "link.uav1", "armed_at_its_end", str(by_radio), kind="link", vehicle="uav1", stop_timeout_s=3.0
    )
    plan = armed_by(
        tmp_path / "armed",
        link,
        landing="lands",
        land_argument=go,
        router_ends_after_s=router_ends_after_s,
    )
    run = begin(start, plan, armed=False)
    run.until("link.uav1", "READY")
    run.signal(signal.SIGTERM)
    run.until_said("uav1 was armed while the arena was stopping: landing again")
    run.until("router", "READY", times=2)
    stopped_at = run.until("link.uav1", "STOPPING")["mono"]
    eventually(lambda: time.monotonic() > stopped_at + 4.0, what="the stop timeout of the link has passed")
    assert is_running(run.pid("link.uav1")) and "SIGKILL" not in run.said()
    by_radio.unlink()
    go.touch()
    assert run.wait() == 0
    assert run.outcome["processes"]["link.uav1"]["exit"] == "exit 0"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_processes_that_serve_a_vehicle_are_restarted_in_the_landing(
    start, tmp_path, number
):  # review fault 7
    flag, go = tmp_path / "armed", tmp_path / "go"
    flag.touch()
    forward = spec("forward.uav1", "good", kind="forward", vehicle="uav1", restart=RESTARTED)
    logger = spec("logger.uav1", "good", kind="logger", vehicle="uav1", restart=RESTARTED)
    run = begin(start, armed_by(flag, forward, logger, landing="lands", land_argument=go))
    run.until("forward.uav1", "READY")
    run.until("logger.uav1", "READY")
    run.signal(signal.SIGTERM)
    run.until_said("landing uav1")
    for name in ("forward.uav1", "router", "logger.uav1", "p"):
        os.kill(process_of(run, name), number)
    run.until("forward.uav1", "READY", times=2)
    run.until("router", "READY", times=2)
    flag.unlink()
    go.touch()
    assert run.wait() == 0
    rows = run.outcome["processes"]
    assert (rows["logger.uav1"]["starts"], rows["p"]["starts"]) == (1, 1)


def process_of(run: Run, name: str) -> int:
    return run.control().ask(do="ps")["processes"][name]["pid"]


def test_landing_is_not_believed_while_a_real_vehicle_reports_armed(start, tmp_path):  # review fault 6
    flag = tmp_path / "armed"
    flag.touch()
    run = begin(start, armed_by(flag, landing="lands"))
    run.signal(signal.SIGTERM)
    run.until_said("uav1: the landing was confirmed, but the vehicle is armed: landing again")
    flag.unlink()
    assert run.wait() == 0


def test_vehicle_with_a_pilot_is_not_commanded(start, tmp_path):  # review fault 5
    flag = tmp_path / "armed"
    flag.touch()
    pilot = spec(
        "link.uav1",
        "world",
        json.dumps({"uav1.control": "pilot"}),
        kind="link",
        vehicle="uav1",
        outlives=True,
    )
    run = begin(start, armed_by(flag, pilot, landing="disarms"))
    run.until("link.uav1", "READY")
    run.signal(signal.SIGHUP)
    run.until_said("uav1: pilot has control; waiting until the vehicle is disarmed")
    run.signal(signal.SIGHUP)
    run.until_said("landing: waiting for uav1 to land: pilot has control")
    assert is_running(run.pid("router")) and is_running(run.pid("p"))
    assert run.log("land") == ""
    flag.unlink()
    assert run.wait() == 0
    assert run.log("land") == "" and run.said().count("pilot has control; waiting") == 1


def test_facts_of_the_router_are_not_crowded_out(start, tmp_path):  # review fault 19
    flag = tmp_path / "armed"
    run = begin(start, armed_by(flag, program("q", "names", "2500")), armed=False)
    eventually(lambda: "wp1999" in run.control().ask(do="ps")["facts"])
    flag.touch()
    eventually(lambda: run.control().ask(do="ps")["facts"]["uav1.armed"] is True)
    assert "wp2000" not in run.control().ask(do="ps")["facts"]
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert "landed all" in run.log("land")


def test_facts_about_vehicles_from_a_program_are_ignored(start, tmp_path):  # review fault 19
    lie = program("liar", "world", json.dumps({"uav1.control": "pilot", "uav1.connected": False, "mine": 1}))
    run = begin(start, armed_by(tmp_path / "armed", lie), armed=False)
    facts = eventually(lambda: (f := run.control().ask(do="ps")["facts"]).get("mine") and f)
    assert "uav1.control" not in facts and facts["uav1.connected"] is True
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


@pytest.mark.parametrize("simulated", [False, True], ids=["real", "simulated"])
def test_program_of_an_armed_real_vehicle_is_not_restarted(start, tmp_path, simulated):
    flag = tmp_path / "armed"
    plan = armed_by(flag)
    flies = replace(plan.processes[1], vehicle="uav1", restart=RESTARTED)
    plan = replace(plan, processes=(plan.processes[0], flies), vehicles=(vehicle(simulated=simulated),))
    flag.touch()
    run = begin(start, plan)
    if not simulated:
        with pytest.raises(RunError, match="p is not restarted: uav1 may be flying"):
            run.control().ask(do="restart", name="p")
    flag.unlink()
    eventually(lambda: run.control().ask(do="ps")["facts"].get("uav1.armed") is False)
    os.kill(run.pid("p"), signal.SIGKILL)
    if simulated:
        run.until("p", "READY", times=2)
    else:
        assert "its real vehicle was armed" in run.until("p", "FATAL")["reason"]
        run.control().ask(do="restart", name="p")
        run.until("p", "READY", times=2)
    run.signal(signal.SIGTERM)
    run.wait()


def test_flight_that_a_paused_supervisor_has_missed_counts(start, tmp_path):
    """When it continues, it reads the reports of a whole flight at once."""
    flag = tmp_path / "armed"
    plan = armed_by(flag)
    flies = replace(plan.processes[1], vehicle="uav1", restart=Restart(mode="on_failure", backoff_s=2.0))
    run = begin(start, replace(plan, processes=(plan.processes[0], flies)), armed=False)
    pid = run.pid("p")
    run.signal(signal.SIGSTOP)
    flag.touch()
    eventually(lambda: "reported ARMED" in run.log("router"))
    flag.unlink()
    eventually(lambda: run.log("router").rstrip().endswith("reported disarmed"))
    os.kill(pid, signal.SIGKILL)
    run.signal(signal.SIGCONT)
    assert "its real vehicle was armed" in run.until("p", "FATAL")["reason"]
    run.signal(signal.SIGTERM)
    run.wait()
