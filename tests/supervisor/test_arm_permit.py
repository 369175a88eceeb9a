"""Which vehicles get an arm permit from `arena up` and `arena arm-permit`."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.cli.arm_permit import vehicle_line
from arena.plan import Plan, make_plan
from arena.schema import load_arena
from arena.supervisor.arm_permit import CONFIRMATION_S, Confirmation, check_permit, real_vehicles
from arena.supervisor.permits import Permits
from arena.supervisor.process_state import ProcessStatus, State

ARENA = """
mocap: {source: natnet, server: 10.0.0.5}
defaults: {profile: iris}
vehicles:
  uav1: {autopilot: builtin}
  uav2: {autopilot: hardware, url: "udpin:127.75.0.1:14540"}
  uav3: {autopilot: hardware, url: "udpin:127.75.0.1:14541"}
"""


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    (tmp_path / "arena.yaml").write_text(ARENA)
    return make_plan(load_arena(tmp_path / "arena.yaml"))


def test_only_connected_real_vehicles_are_permitted_at_the_start(plan):  # review fault 3
    states = {spec.name: ProcessStatus(since=0.0, state=State.READY) for spec in plan.processes}
    states["link.uav3"] = ProcessStatus(since=0.0, state=State.STARTING)
    assert real_vehicles(plan, states) == {"uav2": True, "uav3": False}


def test_a_battery_that_is_connected_long_after_the_confirmation_permits_nothing():  # review fault 3
    given = Confirmation("ada", began=100.0)
    assert not given.is_due(99.9 + CONFIRMATION_S, False)
    assert given.is_due(100.0 + CONFIRMATION_S, False)
    assert not given.is_due(101.0 + CONFIRMATION_S, True)


def test_the_confirmation_is_used_once_when_all_processes_are_ready():
    given = Confirmation("ada", began=100.0)
    assert given.is_due(102.0, True)
    assert not given.is_due(103.0, True)
    assert not Confirmation("", began=100.0).is_due(500.0, True)


@pytest.mark.parametrize(
    ("real", "vehicles", "message"),
    [
        ({}, ["uav1"], "simulated vehicles need no arm permit"),
        ({"uav2": True}, [], "got no vehicle, expected at least one of uav2"),
        ({"uav2": True}, ["uav1"], "got vehicle 'uav1', expected a real vehicle: uav2"),
        ({"uav2": False}, ["uav2"], "link.uav2 is not ready"),
    ],
)
def test_a_permit_that_cannot_be_granted_is_refused(real, vehicles, message):
    with pytest.raises(ValueError, match=message):
        check_permit(real, vehicles)


class DeadLink:
    """Processes of a run of which one link process does not receive requests."""

    def __init__(self, statuses, dead):
        self.statuses, self._dead, self.received = statuses, dead, []

    def request(self, packet, *, to):
        self.received += [name for name in to if name != self._dead]
        return [name for name in to if name == self._dead]


@pytest.mark.parametrize(
    ("dead", "served", "named"), [("link.uav2", "link.uav3", "uav2"), ("link.uav3", "link.uav2", "uav3")]
)
def test_a_dead_link_takes_the_permit_from_its_own_vehicle_only(plan, dead, served, named):
    statuses = {spec.name: ProcessStatus(since=0.0, state=State.READY) for spec in plan.processes}
    processes = DeadLink(statuses, dead)
    permits = Permits(plan, processes, Confirmation("", began=0.0), print)
    with pytest.raises(ValueError, match=f"^{named}: no arm permit: {dead} has ended or hangs"):
        permits.grant(["uav2", "uav3"], "ada")
    assert processes.received == [served]


def test_the_operator_sees_what_is_permitted():
    reasons = ["Preflight: battery at 10 %, needs 20 %", "no arm permit: run arena arm-permit uav2"]
    stats = {"uid": "00ab", "partner": "10.0.0.21:14550", "battery": 10, "may_not_arm": reasons}
    line = vehicle_line("uav2", stats)
    assert line == "uav2: uid 00ab, 10.0.0.21:14550, battery 10 %. Preflight: battery at 10 %, needs 20 %"
    assert (
        vehicle_line("uav2", {})
        == "uav2: uid unknown, not connected, battery unknown. all preflight checks pass"
    )
