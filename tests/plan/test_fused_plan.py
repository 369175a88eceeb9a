"""Plan of an arena whose parts share one process."""

from __future__ import annotations

import pytest

from arena.errors import InputError
from arena.plan import Plan, make_plan
from arena.plan.fused import SLICE, could_be_member, why_many, why_one
from arena.plan.open_ports import open_sockets
from arena.schema import load_arena

TWO = "vehicles:\n  uav1: {program: fly.py}\n  uav2: {start: {position: [1, 0, 0]}}\n"


def plan_of(folder, text: str = TWO, *sets: str) -> Plan:
    (folder / "fly.py").touch()
    (folder / "arena.yaml").write_text(text)
    return make_plan(load_arena(folder / "arena.yaml", sets))


@pytest.mark.parametrize(
    ("sets", "fused"),
    [
        ((), False),
        (("sim.speed=max",), True),
        (("sim.speed=2",), True),
        (("sim.processes=one",), True),
        (("sim.speed=max", "sim.processes=many"), False),
        (("sim.speed=max", "defaults.autopilot=px4", "px4.home=stand-in"), True),
    ],
)
def test_faster_arenas_of_simulated_autopilots_share_a_process(tmp_path, sets, fused):
    names = [p.name for p in plan_of(tmp_path, TWO, *sets).processes]
    assert ("router" not in names) == fused
    assert "world" in names and "program.uav1" in names


HITL = ("sim.processes=one", "vehicles.uav2.autopilot=hitl", "vehicles.uav2.serial=/dev/ttyACM0")


def test_one_process_for_hitl_is_refused_with_the_reason(tmp_path):
    with pytest.raises(InputError, match=r"sim\.processes: got `one`, but uav2 has autopilot: hitl"):
        plan_of(tmp_path, TWO, *HITL)


def test_fused_plan_with_px4_keeps_its_sockets_and_needs(tmp_path):
    sets = (
        "sim.processes=one",
        "defaults.autopilot=builtin",
        "vehicles.uav1.autopilot=px4",
        "px4.home=stand-in",
    )
    world, px4, program = plan_of(tmp_path, TWO, *sets).processes
    assert (px4.name, px4.needs) == ("px4.uav1", ("world",))
    assert set(program.needs) == {"world", "px4.uav1", "router", "forward.uav1", "recorder"}
    opened = {x.what for x in world.listens}
    assert {"router link of uav1", "vision link of uav1"} <= opened
    assert not opened & {"router link of uav2", "vision link of uav2"}


def test_fused_plan_keeps_ports_slices_and_needs(tmp_path):
    many, one = plan_of(tmp_path), plan_of(tmp_path, TWO, "sim.processes=one")
    of_many = {x for p in many.processes for x in p.listens}
    in_memory = {
        x for x in of_many if x.what.startswith(("router link", "vision link", "ground station link"))
    }
    assert {x for p in one.processes for x in p.listens} == of_many - in_memory and len(in_memory) == 12
    world, program = one.processes[0], one.processes[1]
    joined = [p.name for p in many.processes if p.name not in ("world", "program.uav1")]
    assert [m.name for m in world.members] == joined
    assert program.needs == ("world", "forward.uav1", "router", "recorder")
    expected = {"name": "world", "members": ["world", *joined], "sleepers": {}, "poses": None}
    assert one.slices["fused.json"] == expected
    assert one.slices["world.json"]["expected"] == []
    fast = plan_of(tmp_path, TWO, "sim.speed=max").slices
    assert fast["world.json"]["expected"] == ["uav1"]
    assert fast["fused.json"]["sleepers"] == {"uav1": "uav1"}
    assert all(one.slices[f"{name}.json"] == many.slices[f"{name}.json"] for name in joined)
    assert Plan.from_json(one.to_json()) == one


def test_programs_on_the_simulation_clock_read_poses_from_shared_memory(tmp_path):
    text = TWO.replace("[1, 0, 0]}}", "[1, 0, 0]}, program: fly.py, mocap_body: big}")
    fast, slow = plan_of(tmp_path, text, "sim.speed=max"), plan_of(tmp_path, text, "sim.processes=one")
    assert fast.slices["fused.json"]["poses"] == "{rt}/poses"
    rows = {body["name"]: row for row, body in enumerate(fast.slices["mocap.json"]["bodies"])}
    assert rows == {"uav1": 0, "big": 1}
    for name, row in (("uav1", 0), ("uav2", 1)):
        found = fast.slices[f"program.{name}.json"]["capture"]
        assert found == {"kind": "page", "path": "{rt}/poses", "row": row}
        assert slow.slices[f"program.{name}.json"]["capture"]["kind"] == "natnet", "in real time"
    assert not [x for x in open_sockets(fast) if x.process.startswith("program.") and "NatNet" in x.what]


@pytest.mark.parametrize("processes", ["one", "many"])
def test_every_port_of_the_plan_is_in_the_list_of_sockets(tmp_path, processes):
    plan = plan_of(tmp_path, TWO + "copilot: {}\n", f"sim.processes={processes}")
    listed = {(x.protocol, x.port) for x in open_sockets(plan)}
    assert {(x.protocol, x.port) for p in plan.processes for x in p.listens} <= listed


def test_accepted_senders_of_every_socket_are_known(tmp_path):
    plan = plan_of(tmp_path, TWO, "sim.processes=one")
    found = {x.what.partition(" of ")[0]: x.who for x in open_sockets(plan) if x.process == "world"}
    assert found.keys() >= {
        "panic link",
        "tools",
        "programs",
        "ground stations",
        "record",
        "NatNet commands",
        "fault injection",
    }
    assert "?" not in found.values()


def test_world_does_not_wait_for_programs_that_cannot_use_its_clock(tmp_path):
    (tmp_path / "fly.sh").touch(mode=0o755)
    plan = plan_of(tmp_path, TWO.replace("fly.py", "{path: fly.sh, clock: simulation}"), "sim.speed=max")
    assert plan.slices["world.json"]["expected"] == []


@pytest.mark.parametrize(
    ("sets", "reason"),
    [
        ((), "in real time"),
        (("sim.processes=many", "sim.speed=max"), "sim.processes is many"),
        (("sim.speed=max", "defaults.autopilot=px4", "px4.home=stand-in"), ""),
        (("sim.speed=max",), ""),
    ],
)
def test_reason_for_many_processes(tmp_path, sets, reason):
    plan_of(tmp_path)
    found = why_many(load_arena(tmp_path / "arena.yaml", sets))
    assert found.startswith(reason) and bool(found) == bool(reason)


@pytest.mark.parametrize(
    ("vehicles", "sets", "one"),
    [
        (4, (), False),
        (5, (), True),
        (5, ("sim.processes=many",), False),
        (5, ("defaults.autopilot=px4", "px4.home=stand-in"), False),
    ],
)
def test_many_vehicles_share_a_process_in_real_time(tmp_path, vehicles, sets, one):
    grid = "start: {position: [-3, -3, 0], grid: {columns: 3, spacing_m: 2}}"
    text = f"world: {{size: [12, 12, 3]}}\nvehicles:\n  uav1..uav{vehicles}: {{{grid}}}\n"
    plan = plan_of(tmp_path, text, *sets)
    arena = load_arena(tmp_path / "arena.yaml", sets)
    assert (SLICE in plan.slices) == one == (not why_many(arena))
    assert not one or "less CPU time" in why_one(arena)


@pytest.mark.parametrize(
    ("name", "joined"),
    [("forward.uav1", True), ("router", True), ("world", True), ("program.uav1", False), ("copilot", False)],
)
def test_parts_that_can_share_a_process(name, joined):
    assert could_be_member(name) == joined
