"""The process table and the port table: complete, consistent, and enough to add a kind of process."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from arena.plan import make
from arena.plan.process_table import SILENT_S, TABLE, ProcessKind
from arena.schema import Arena, load_arena
from arena.schema.ports import PORTS, Binder, Port, vehicle_ports

USER_KINDS = {"task", "tool"}


@pytest.fixture
def arena(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Arena:
    monkeypatch.chdir(tmp_path)
    Path("arena.yaml").write_text("vehicles: {uav1: {autopilot: builtin}}\n")
    return load_arena("arena.yaml")


def test_every_module_of_the_table_can_be_run() -> None:
    for row in TABLE:
        assert not row.module or importlib.util.find_spec(f"{row.module}.__main__"), row.module


def test_every_row_has_a_budget_and_a_purpose() -> None:
    assert all(row.cpu_budget > 0 and row.memory_budget_mb > 0 and row.purpose for row in TABLE)


def test_hung_router_forwarder_and_link_are_detected() -> None:  # review fault 21
    limits = {row.kind: row.fields.get("silent_for_s") for row in TABLE}
    assert limits["router"] == limits["forward"] == limits["link"] == SILENT_S > 5 * 1.0


def test_every_port_is_bound_by_kinds_of_the_table() -> None:
    kinds = {row.kind for row in TABLE} | USER_KINDS
    assert {binder.kind for port in PORTS for binder in port.binders} <= kinds


def test_every_binder_names_the_senders_it_answers() -> None:
    assert all(binder.answers for port in PORTS for binder in port.binders)


def test_ports_of_vehicles_follow_the_rules_of_the_table() -> None:
    ports = vehicle_ports(3)
    for port in PORTS:
        if port.base is not None:
            first = 24000 if port.step == 10 else 27000
            offset = port.base - first
            assert getattr(ports, port.key) == first + 3 * port.step + offset
            assert port.rule == f"{first} + {port.step} id" + (f" + {offset}" if offset else "")


def test_process_kind_is_added_by_one_row_and_one_port(arena: Arena, monkeypatch: pytest.MonkeyPatch) -> None:
    beacon = ProcessKind(
        kind="beacon",  # type: ignore[arg-type]  a kind of this test
        module="arena.beacon",
        purpose="announces the vehicle",
        per_vehicle=True,
        needs=lambda job: ("router",),
        slice=lambda job: {"name": f"beacon.{job.v.name}", "id": job.v.id},
        cpu_budget=0.1,
        memory_budget_mb=50.0,
    )
    socket = Port(
        key="tools",
        rule="by rule",
        name="beacon",
        owner="the beacon",
        use="announcements",
        binders=(Binder(kind="beacon", answers="nobody"),),
    )
    monkeypatch.setattr(make, "TABLE", (*TABLE, beacon))
    monkeypatch.setattr("arena.plan.process_table.PORTS", (socket,))
    plan = make.make_plan(arena, "py")
    spec = plan.processes[-1]
    assert (spec.name, spec.vehicle, spec.needs) == ("beacon.uav1", "uav1", ("router",))
    assert spec.argv == ("py", "-m", "arena.beacon", "{run}/slices/beacon.uav1.json")
    assert plan.slices["beacon.uav1.json"] == {"name": "beacon.uav1", "id": 1}
    assert [(x.port, x.what) for x in spec.listens] == [(24016, "beacon of uav1")]
    assert "beacon.uav1" in make.process_names(arena)
