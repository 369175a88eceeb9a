"""`arena release`: refused when nothing is to release, else sent to the processes that pass commands to the vehicle."""

from __future__ import annotations

import json
import signal

import pytest

from arena.errors import RunError
from arena.supervisor.release import check_release, guards

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
        (["uav1"], "uav1: nothing to release: program has control"),
        (["uav9"], "got vehicle 'uav9', expected one of uav1, uav2"),
        ([], "got no vehicle, expected at least one of uav1, uav2"),
    ],
)
def test_release_is_refused_with_its_reason(vehicles, words):
    with pytest.raises(ValueError, match=words):
        check_release(plan(), FREE, {}, vehicles)


def test_release_reaches_the_router_and_is_refused_at_the_end(start):
    router = spec("router", "prints_requests", json.dumps(BLOCKED), kind="router")
    run = start(plan_of(router, spec("n", "ignores_sigterm"), vehicles=(vehicle(),)))
    eventually(lambda: "uav1.blocked" in run.control().ask(do="ps")["facts"])
    assert run.control().ask(do="release", vehicles=["uav1"], by="ada") == {"ok": True}
    eventually(lambda: '{"do": "release", "vehicle": "uav1", "by": "ada"}' in run.log("router"))
    with pytest.raises(RunError, match="uav9"):
        run.control().ask(do="release", vehicles=["uav9"], by="ada")
    run.signal(signal.SIGTERM)
    run.wait()
    assert '{"do": "refuse_arming", "why": "the run is ending"}' in run.log("router")  # review fault 6
