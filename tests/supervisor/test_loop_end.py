"""The end of a run: landing first, signals at any moment, restarts in flight, a killed supervisor."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from arena.cli._running import find
from arena.errors import RunError
from arena.supervisor import open_run

from .conftest import CHILDREN, Run, eventually, is_running, plan_of, program, spec, vehicle, world

ARMED = json.dumps({"uav1.armed": True})


def flying(tmp_path: Path, *more, simulated=True, landing="lands", waits=True, program_kind="sleeps"):
    """A plan with an armed vehicle. It lands when the test touches `go`; the fact follows the land task's `landed`."""
    go = (str(tmp_path / "go"),) if waits else ()
    land = spec("land", landing, *go, kind="task")
    return plan_of(
        world(ARMED, "{}", "landed"),
        program("p", program_kind, needs=("world",)),
        *more,
        vehicles=(vehicle(simulated=simulated),),
        land=land,
    )


def begin(start, plan, *options) -> Run:
    run = start(plan, *options)
    eventually(lambda: (run.control().ask(do="ps")["facts"] or {}).get("uav1.armed") is True)
    run.until("p", "READY")
    return run


@pytest.fixture
def bystander():
    """A process that is none of ours, whatever a state.json says."""
    command = [sys.executable, str(CHILDREN / "misfit.py"), "sleeps"]
    with subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL) as process:
        yield process
        process.kill()


def test_ctrl_c_lands_while_everything_runs_then_stops_and_exits_130(start, tmp_path):
    run = begin(start, flying(tmp_path))
    run.signal(signal.SIGINT)
    run.until_said("landing all")
    assert is_running(run.pid("p")) and is_running(run.pid("world"))
    (tmp_path / "go").touch()
    assert run.wait() == 130
    assert "landed all" in run.log("land")
    events = run.events()
    landed = next(i for i, e in enumerate(events) if "landed all" in e.get("event", ""))
    assert all(i > landed for i, e in enumerate(events) if e.get("to") == "STOPPING")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_sigterm_and_sighup_land_and_succeed(start, tmp_path, number):
    run = begin(start, flying(tmp_path, waits=False))
    run.signal(number)
    assert run.wait() == 0
    assert "landed all" in run.log("land")
    assert run.outcome["landing"] == "landed and disarmed"


def test_second_ctrl_c_kills_programs_only(start, tmp_path):
    run = begin(start, flying(tmp_path, program_kind="ignores_sigterm"))
    run.signal(signal.SIGINT)
    run.until_said("landing all")
    run.signal(signal.SIGINT)
    run.until("p", "EXITED")
    for _ in range(5):
        run.signal(signal.SIGINT)
    run.until_said("landing: waiting for uav1 to land")
    assert is_running(run.pid("world")) and is_running(run.pid("land"))
    (tmp_path / "go").touch()
    assert run.wait() == 130


def test_double_ctrl_c_during_the_start_leaves_nothing(start, tmp_path):
    run = start(
        plan_of(world(), spec("n", "never_ready", needs=("world",)), program("p", "sleeps", needs=("n",)))
    )
    run.until("n", "STARTING")
    run.signal(signal.SIGINT)
    run.signal(signal.SIGINT)
    assert run.wait() == 130
    assert run.outcome["processes"]["p"]["starts"] == 0


def test_unconfirmed_landing_is_repeated_then_fails_the_run(start, tmp_path):
    run = begin(start, flying(tmp_path, landing="dies_at_once"))
    run.signal(signal.SIGINT)
    assert run.wait() == 1
    assert run.outcome["failed"][0] == "the landing was not confirmed"
    assert "pid" in run.log("land") and run.log("land").count("pid") == 3


def test_stopped_land_task_is_killed_and_repeated(start, tmp_path):
    run = begin(start, flying(tmp_path))
    run.signal(signal.SIGINT)
    os.kill(run.pid("land"), signal.SIGSTOP)
    run.until_said("the landing of uav1 is not confirmed (paused by SIGSTOP: killed by SIGKILL)")
    (tmp_path / "go").touch()
    assert run.wait() == 130
    assert run.outcome["landing"] == "landed and disarmed" and run.log("land").count("pid") == 2


def test_real_vehicle_is_served_until_its_landing_is_confirmed(start, tmp_path):
    run = begin(start, flying(tmp_path, simulated=False, landing="dies_at_once"))
    run.signal(signal.SIGINT)
    eventually(lambda: run.log("land").count("pid") >= 4)
    assert is_running(run.pid("world"))
    os.kill(run.pid("world"), signal.SIGKILL)  # not a simulated vehicle: it may still fly
    run.until("world", "EXITED")
    assert run.process.poll() is None
    run.end()


def test_until_done_waits_for_disarmed(start, tmp_path):
    plan = plan_of(
        world(ARMED, "{}", str(tmp_path / "disarmed")),
        program("p", "exits", "0", needs=("world",)),
        vehicles=(vehicle(),),
        land=spec("land", "lands", kind="task"),
    )
    run = start(plan, "until_done")
    run.until("p", "EXITED")
    assert run.control().ask(do="ps")["phase"] == "running"
    (tmp_path / "disarmed").touch()
    assert run.wait() == 0
    assert run.outcome["cause"] == "done" and run.log("land") == ""


@pytest.mark.parametrize("kind", ["forward", "router"])
def test_restart_in_flight_is_refused_without_yes(start, tmp_path, kind):
    serves = spec("serves", "good", kind=kind)
    run = begin(start, flying(tmp_path, serves, waits=False))
    run.until("serves", "READY")
    with pytest.raises(RunError, match=r"serves is not restarted: uav1 may be flying\. During .* --yes"):
        run.control().ask(do="restart", name="serves")
    assert run.control().ask(do="restart", name="serves", yes=True) == {"ok": True}
    run.until("serves", "READY", times=2)
    assert run.control().ask(do="restart", name="p") == {"ok": True}, "a program is the user's own"
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_restart_on_the_ground_is_allowed(start):
    disarmed = world(json.dumps({"uav1.armed": False}))
    plan = plan_of(disarmed, spec("forward.uav1", "good", kind="forward"), vehicles=(vehicle(),))
    run = start(plan)
    eventually(lambda: run.control().ask(do="ps")["facts"] == {"uav1.armed": False})
    run.until("forward.uav1", "READY")
    assert run.control().ask(do="restart", name="forward.uav1") == {"ok": True}
    run.until("forward.uav1", "READY", times=2)
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_short_disarm_does_not_end_a_run(start):
    plan = plan_of(
        world(), spec("router", "flickers", kind="router"), program("p", "exits", "0"), vehicles=(vehicle(),)
    )
    run = start(plan, "until_done", "settle=5")
    assert run.wait() == 0
    assert run.outcome["processes"]["router"]["stats"] == {"disarmed": True}


def test_lost_world_fails_the_run_without_a_landing(start, tmp_path):
    run = begin(start, flying(tmp_path))
    os.kill(run.pid("world"), signal.SIGKILL)
    assert run.wait() == 1
    assert run.outcome["failed"] == ["world: killed by SIGKILL"]
    assert run.log("land") == ""


def test_landing_runs_when_the_router_has_died(start, tmp_path):
    """Its last word was `disarmed`, but a program has run since: what it knew proves nothing any more."""
    router = spec("router", "world", json.dumps({"uav1.armed": False}), kind="router")
    plan = plan_of(
        world(),
        router,
        program("p", "sleeps", needs=("router",)),
        vehicles=(vehicle(),),
        land=spec("land", "lands", kind="task"),
    )
    run = start(plan)
    run.until("p", "READY")
    os.kill(run.pid("router"), signal.SIGKILL)
    assert run.wait() == 1
    assert "landed all" in run.log("land")


def test_disarmed_reported_by_a_program_is_ignored(start, tmp_path):
    liar = program("liar", "world", json.dumps({"uav1.armed": False}))
    run = begin(start, flying(tmp_path, liar, waits=False))
    run.until("liar", "READY")
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert "landed all" in run.log("land")


def test_closed_terminal_does_not_prevent_the_landing(start, tmp_path):
    ours, theirs = os.openpty()
    run = start(flying(tmp_path, waits=False), stdout=theirs, stderr=theirs)
    os.close(theirs)
    run.until("p", "READY")
    os.close(ours)
    run.signal(signal.SIGHUP)
    assert run.wait() == 0
    assert "landed all" in run.log("land")


def test_a_closed_pipe_does_not_end_the_run(start, tmp_path):
    reading, writing = os.pipe()
    run = start(flying(tmp_path, waits=False), stdout=writing, stderr=writing)
    os.close(writing)
    os.close(reading)
    run.until("p", "READY")
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_user_learns_that_all_programs_have_ended_and_the_arena_has_not(start, tmp_path):
    plan = plan_of(
        world(ARMED, json.dumps({"uav1.armed": False}), str(tmp_path / "disarmed")),
        program("p", "exits", "0", needs=("world",)),
        vehicles=(vehicle(),),
        land=spec("land", "lands", kind="task"),
    )
    run = start(plan)
    run.until("p", "EXITED")
    told = "every program has ended and every vehicle is disarmed. The arena continues: Ctrl-C ends it"
    assert told not in run.said(), "the vehicle is armed"
    (tmp_path / "disarmed").touch()
    run.until_said(told)
    assert run.control().ask(do="ps")["phase"] == "running" and run.said().count(told) == 1
    run.signal(signal.SIGINT)
    assert run.wait() == 130


def test_commands_report_a_dead_supervisor_while_its_processes_run(start, tmp_path):
    plan = flying(tmp_path, spec("stubborn", "ignores_sigterm", outlives=True, kind="world"), waits=False)
    run = begin(start, plan)
    run.until("stubborn", "READY")
    run.signal(signal.SIGKILL)
    run.wait()
    with pytest.raises(RunError, match=r"has died, and its processes still run.*arena down --run"):
        find(None)
    run_python("from arena.supervisor import sweep_all; sweep_all(print, '127.53.0.1')")
    with pytest.raises(RunError, match="no arena is running"):
        find(None)


def test_killed_supervisor_ends_programs_and_closes_the_sockets_of_others(start, tmp_path):
    run = begin(start, flying(tmp_path, program_kind="ignores_sigterm"))
    program_pid, world_pid = run.pid("p"), run.pid("world")
    run.signal(signal.SIGKILL)
    run.wait()
    eventually(lambda: not is_running(program_pid), what="end of the program")
    eventually(lambda: "saw the end of the line" in run.log("world"), what="end of file")
    eventually(lambda: not is_running(world_pid), what="end of the world")


def test_down_now_stops_simulated_vehicles_in_the_air_at_once(start, tmp_path):
    """Also a program that would take its time, and a landing that has begun."""
    run = begin(start, flying(tmp_path, program_kind="ignores_sigterm"))
    run.signal(signal.SIGTERM)
    run.until_said("landing all")
    run.control().ask(do="down", now=True)
    assert run.wait() == 0, "the landing would have waited for ever"
    assert "landed all" not in run.log("land")
    assert run.outcome["landing"] == "uav1 not landed: arena down --now"


def test_down_now_lands_a_real_vehicle_first_and_says_so(start, tmp_path):
    run = begin(start, flying(tmp_path, simulated=False))
    run.control().ask(do="down", now=True)
    run.until_said("landing all")
    run.until_said("processes that serve a real vehicle continue until it has landed")
    run.until("p", "EXITED")
    assert is_running(run.pid("world"))
    (tmp_path / "go").touch()
    assert run.wait() == 0
    assert run.outcome["landing"] == "landed and disarmed"


def test_down_now_of_a_mixed_arena_lands_real_vehicles_only(start, tmp_path):
    both, go = json.dumps({"uav1.armed": True, "uav2.armed": True}), tmp_path / "go"
    go.touch()
    plan = plan_of(
        world(both, "{}", "landed"),
        program("p", "sleeps", needs=("world",)),
        vehicles=(vehicle(simulated=True), vehicle("uav2", simulated=False)),
        land=spec("land", "lands", str(go), kind="task"),
    )
    run = begin(start, plan)
    run.control().ask(do="down", now=True)
    run.until_said("the landing does not wait for uav1: arena down --now lands real vehicles only")
    run.wait()
    (told,) = [e["event"] for e in run.events("arena") if e.get("event", "").startswith("landing uav2: ")]
    assert told.endswith("--except uav1")


@pytest.mark.parametrize("simulated", [True, False])
def test_down_now_of_a_stale_run_lands_real_vehicles_only(start, tmp_path, simulated):
    go = tmp_path / "go"
    go.touch()
    run = begin(
        start,
        flying(
            tmp_path, spec("stubborn", "ignores_sigterm", outlives=True, kind="world"), simulated=simulated
        ),
    )
    run.until("stubborn", "READY")
    eventually(lambda: (s := open_run(run.folder)) and len(s.processes) == 3)
    run.signal(signal.SIGKILL)
    run.wait()
    code = "from arena.supervisor import active_runs, sweep; [sweep(state, print, now=True) for state in active_runs()]"
    said = run_python(code)
    assert ("landed all" in said) is not simulated
    assert ("uav1 may be flying: real vehicles are landed even with --now" in said) is not simulated
    assert not is_running(run.pid("stubborn")) and open_run(run.folder) is None


def test_sweep_kills_no_process_of_a_real_vehicle_without_another_landing(start, tmp_path):  # review fault 6
    """The process does not end on its stop signal: its vehicle may have been armed again after the first landing."""
    stubborn = spec("stubborn", "ignores_sigterm", outlives=True, kind="link", vehicle="uav1")
    plan = plan_of(
        stubborn,
        vehicles=(vehicle(simulated=False),),
        land=spec("land", "lands_once", str(tmp_path / "landed once"), kind="task"),
    )
    run = start(plan)
    run.until("stubborn", "READY")
    eventually(lambda: (s := open_run(run.folder)) and s.processes)
    run.signal(signal.SIGKILL)
    run.wait()
    said = run_python(
        "from arena.errors import RunError\n"
        "from arena.supervisor import active_runs, sweep\n"
        "for state in active_runs():\n"
        "    try: sweep(state, print)\n"
        "    except RunError as error: print('refused:', error)"
    )
    assert "did not end within 0.3 s, and the landing is not confirmed. Land and disarm the vehicle" in said
    assert is_running(run.pid("stubborn")) and open_run(run.folder) is not None
    run.end()


def test_sweep_lands_then_ends_recorded_processes_only(start, tmp_path, bystander):
    plan = flying(tmp_path, spec("stubborn", "ignores_sigterm", outlives=True, kind="world"), waits=False)
    run = begin(start, plan)
    run.until("stubborn", "READY")
    state = eventually(lambda: (s := open_run(run.folder)) and len(s.processes) == 3 and s)
    forged = json.loads((run.folder / "state.json").read_text())
    forged["processes"]["reused"] = {"pid": bystander.pid, "pgid": bystander.pid, "start_s": 1.0}
    run.signal(signal.SIGKILL)
    run.wait()
    (run.folder / "state.json").write_text(json.dumps(forged))
    sweep = run_python("from arena.supervisor import sweep_all; sweep_all(print, '127.53.0.1')")
    assert "stubborn" in sweep and "killing" in sweep and "landed all" in sweep
    assert not is_running(run.pid("stubborn")) and bystander.poll() is None
    assert not Path(state.rt).exists() and open_run(run.folder) is None


def run_python(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    ).stdout
