"""Plan of the emulated relative sensors: configuration, ports, processes."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from arena.plan import make_plan
from arena.plan.model import Plan
from arena.schema import load_arena

TEXT = """\
sim: {processes: PROCESSES}
world: {seed: 9}
beacons: {door: [3, -1, -2], window: [-3, 1, -2]}
vehicles:
  uav1: {autopilot: builtin, program: fly.py, neighbours: {source: estimator, rate_hz: 4, vehicles: [uav3]}}
  uav2: {autopilot: builtin, start: {position: [1, 0, 0]}, beacon_sensor: {beacons: [window], rate_hz: 2}}
  uav3: {autopilot: builtin, start: {position: [2, 0, 0]}, mocap_body: three}
  uav4: {autopilot: builtin, start: {position: [3, 0, 0]}}
"""


def planned(folder: Path, processes: str) -> Plan:
    (folder / "fly.py").write_text("")
    (folder / "arena.yaml").write_text(TEXT.replace("PROCESSES", processes))
    return make_plan(load_arena(folder / "arena.yaml"), "py")


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    return planned(tmp_path, "many")


def test_slice_contains_the_vehicles_with_sensors_and_their_neighbours(plan: Plan) -> None:
    s = plan.slices["sensors.json"]
    assert [v["name"] for v in s["vehicles"]] == ["uav1", "uav2", "uav3"] and s["seed"] == 9
    uav1, uav2, uav3 = s["vehicles"]
    assert uav1["router"] == ["127.0.0.1", 24017] and uav3["router"] is None
    assert [v["estimated"] for v in s["vehicles"]] == [True, False, True]
    assert uav1["neighbours"]["vehicles"] == ["uav3"] and uav1["beacons"] is None
    assert uav2["beacons"]["beacons"] == [{"number": 2, "name": "window", "position": [-3.0, 1.0, -2.0]}]
    assert uav2["beacons"]["bearing_noise"] == pytest.approx(math.radians(1.0))
    assert [c["bodies"] for c in s["captures"]] == [["uav2"]], "estimates need no motion capture"


def test_program_gets_numbers_and_age_limits_of_its_sensors(plan: Plan) -> None:
    one, two = plan.slices["program.uav1.json"], plan.slices["program.uav2.json"]
    assert one["neighbours"] == [{"name": "uav3", "id": 3}] and one["neighbours_stale_s"] == 0.75
    assert two["beacons"] == [{"name": "window", "number": 2}] and two["beacons_stale_s"] == 1.5


def test_router_accepts_measurements_only_for_vehicles_with_sensors(plan: Plan) -> None:
    router = plan.slices["router.json"]
    assert router["sensors"] == ["127.0.0.1", 24003]
    assert [v["sensors"] for v in router["vehicles"]] == [
        ["127.0.0.1", 24017],
        ["127.0.0.1", 24027],
        None,
        None,
    ]


def test_program_waits_for_the_sensors(plan: Plan) -> None:
    needs = {p.name: p.needs for p in plan.processes}
    assert "sensors" in needs["program.uav1"] and needs["sensors"] == ("world", "mocap", "router")


def test_fused_arena_has_the_sensors_as_a_member_without_ports(tmp_path: Path) -> None:
    plan = planned(tmp_path, "one")
    world = next(p for p in plan.processes if p.name == "world")
    assert "sensors" in [m.name for m in world.members]
    assert "sensors" in plan.slices["fused.json"]["members"]
    assert {x.port for x in world.listens}.isdisjoint({24003, 24017, 24027})


def test_arena_without_sensors_has_no_such_process(tmp_path: Path) -> None:
    (tmp_path / "arena.yaml").write_text("vehicles:\n  uav1: {}\n")
    plan = make_plan(load_arena(tmp_path / "arena.yaml"), "py")
    assert "sensors.json" not in plan.slices and "sensors" not in [p.name for p in plan.processes]


def test_resolved_yaml_gives_the_same_sensors(plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "resolved.yaml").write_text(plan.yaml)
    again = make_plan(load_arena(tmp_path / "resolved.yaml"), "py")
    assert again.slices["sensors.json"] == plan.slices["sensors.json"]
