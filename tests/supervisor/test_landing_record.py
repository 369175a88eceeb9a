"""Landings that `land-all` has recorded: a process that missed the command gets them from the supervisor."""

from __future__ import annotations

import json
import os
import signal
import time

from arena.emergency.run_record import record_command
from arena.plan.model import Restart

from .conftest import eventually, plan_of, spec, vehicle
from .test_release import BLOCKED, release

RESTORE = '{"do": "restore", "vehicle": "uav1", "standing": {"latch": [4, %d]}}'
LANDING, STOP = RESTORE % 3, RESTORE % 4


def router(**changes):
    given = {"kind": "router", "restart": Restart(mode="on_failure", backoff_s=0.05), **changes}
    return spec("router", "prints_requests", json.dumps(BLOCKED), **given)


def end(run):
    run.signal(signal.SIGTERM)
    run.wait()


def test_router_that_starts_after_land_all_gets_the_landing(start, tmp_path):
    late = spec("late", "good", ready="file", ready_value=str(tmp_path / "go"))
    run = start(plan_of(late, router(needs=("late",)), vehicles=(vehicle(),)))
    run.until("late", "STARTING")
    record_command(run.folder, "land-all", ["uav1", "somebody"])
    (tmp_path / "go").touch()
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    end(run)


def test_starting_router_gets_landing_and_motor_stop(start, tmp_path):
    run = start(plan_of(router(ready="file", ready_value=str(tmp_path / "go")), vehicles=(vehicle(),)))
    run.until("router", "STARTING")
    record_command(run.folder, "land-all", ["uav1"])
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    with (run.folder / "emergency.jsonl").open("a") as file:
        file.write('[]\n{"mono": "1", "command": "land-all", "vehicles": ["uav1"]}\nno JSON\n')
    record_command(run.folder, "kill-all", ["uav1"])
    eventually(lambda: STOP in run.log("router"), what="the stop of the motors, in the log of the router")
    assert run.log("router").count(LANDING) == 1
    end(run)


def test_killed_router_gets_the_landing_after_its_restart(start):
    run = start(plan_of(router(), vehicles=(vehicle(),)))
    ready_at = run.until("router", "READY")["mono"]
    eventually(lambda: time.monotonic() > ready_at + 1.5, what="the router has been ready for 1.5 s")
    record_command(run.folder, "land-all", ["uav1"])
    os.kill(run.pid("router"), signal.SIGKILL)
    run.until("router", "READY", times=2)
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    end(run)


def test_released_landing_is_not_restored(start):
    run = start(plan_of(router(), vehicles=(vehicle(),)))
    run.until("router", "READY")
    record_command(run.folder, "land-all", ["uav1"])
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    assert release(run).returncode == 0
    os.kill(run.pid("router"), signal.SIGKILL)
    run.until("router", "READY", times=2)
    end(run)
    assert run.log("router").count(LANDING) == 1
