"""The plan of an arena: pure, by the rule table, complete."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from arena.plan import Plan, ProcessSpec, make_plan
from arena.plan.make import process_names
from arena.schema import Arena, load_arena
from arena.wire.mavlink_ids import LARGEST_VEHICLE_ID

FLEET = """\
tools: {rec: {argv: [sleep, "1e3"], env: {B: "2", A: "1"}, restart: always}}
vehicles:
  uav1: {start: {position: [0, 0, 0]}, program: hover.py, args: [fast], neighbours: [uav2], gcs: [10.0.0.5]}
  uav2: {start: {position: [-2, 0, 0], rpy_deg: [0, 0, 90]}, program: fly, mocap_body: aero2, port: 17002}
  uav3: {start: {position: [2, 0, 0]}, forward: false, gcs: [10.0.0.5, 10.0.0.6],
         tools: {view: {argv: [sleep, "1"], needs: [world]}}}
"""


@pytest.fixture
def arena(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Arena:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hover.py").touch()
    (tmp_path / "fly").touch(mode=0o755)
    (tmp_path / "arena.yaml").write_text(FLEET)
    return load_arena("arena.yaml")


@pytest.fixture
def plan(arena: Arena) -> Plan:
    return make_plan(arena, "py")


def process(plan: Plan, name: str) -> ProcessSpec:
    return {p.name: p for p in plan.processes}[name]


def test_the_plan_is_pure(arena: Arena, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("make_plan must not do that")

    first = make_plan(arena, "py")
    calls = (
        "builtins.open",
        "os.stat",
        "os.listdir",
        "socket.socket",
        "subprocess.Popen",
        "time.time",
        "time.monotonic",
    )
    with monkeypatch.context() as m:
        for target in calls:
            m.setattr(target, refuse)
        second = make_plan(arena, "py")
    assert second == first


def test_plan_is_read_back_equal_from_json(plan: Plan) -> None:
    assert Plan.from_json(plan.to_json()) == plan


def test_the_resolved_yaml_loads_to_the_same_plan(plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "resolved.yaml").write_text(plan.yaml)
    again = make_plan(load_arena(tmp_path / "resolved.yaml"), "py")
    assert dataclasses.replace(again, yaml="") == dataclasses.replace(plan, yaml="")


def test_processes_and_their_needs(plan: Plan) -> None:
    assert {p.name: p.needs for p in plan.processes} == {
        "world": (),
        "mocap": ("world",),
        "forward.uav1": ("world", "mocap"),
        "forward.uav2": ("world", "mocap"),
        "router": ("world",),
        "sensors": ("world", "mocap", "router"),
        "recorder": ("world",),
        "program.uav1": ("forward.uav1", "router", "sensors", "recorder"),
        "program.uav2": ("forward.uav2", "router", "recorder"),
        "tool.rec": ("router",),
        "tool.uav3.view": ("world",),
    }


def test_process_starts_after_its_needs(plan: Plan) -> None:
    started: set[str] = set()
    for spec in plan.processes:
        assert set(spec.needs) <= started, spec.name
        started.add(spec.name)


def test_process_names_are_those_of_the_plan(arena: Arena, plan: Plan) -> None:
    assert [p.name for p in plan.processes] == process_names(arena)


def test_processes_of_a_flying_vehicle_outlive_the_supervisor(plan: Plan) -> None:
    for spec in plan.processes:
        assert spec.outlives == (spec.kind in ("world", "mocap", "forward", "router", "recorder")), spec.name


def test_only_processes_that_can_restart_in_flight_do(plan: Plan) -> None:
    modes = {p.kind: p.restart.mode for p in plan.processes}
    assert modes == {
        "world": "never",
        "mocap": "on_failure",
        "forward": "on_failure",
        "router": "on_failure",
        "sensors": "on_failure",
        "recorder": "on_failure",
        "program": "never",
        "tool": "never",
    }
    assert process(plan, "tool.rec").restart.mode == "always"


def test_the_commands(plan: Plan, tmp_path: Path) -> None:
    assert process(plan, "world").argv == ("py", "-m", "arena.sim", "{run}/slices/world.json")
    one, two = process(plan, "program.uav1"), process(plan, "program.uav2")
    assert one.argv == ("py", str(tmp_path / "hover.py"), "--uav", "{run}/slices/program.uav1.json", "fast")
    assert two.argv == (str(tmp_path / "fly"),)
    assert one.cwd == two.cwd == str(tmp_path) and one.ready == "started"
    assert plan.land is not None and plan.land.argv == (
        "py",
        "-m",
        "arena.emergency.land_all",
        "--run",
        "{run}",
    )
    assert (
        plan.report is not None
        and plan.report.argv == ("py", "-m", "arena.report", "{run}")
        and plan.report.nice == 10
    )
    for spec in plan.processes:
        assert ("OMP_NUM_THREADS", "1") in spec.env and ("PYTHONUNBUFFERED", "1") in spec.env
    assert process(plan, "tool.rec").env[-2:] == (("A", "1"), ("B", "2"))


def test_world_takes_a_higher_priority_only_when_asked(arena: Arena, plan: Plan) -> None:
    assert all(spec.nice >= 0 for spec in plan.processes)
    asked = dataclasses.replace(arena, sim=arena.sim.model_copy(update={"realtime": True}))
    assert process(make_plan(asked, "py"), "world").nice == -10


def test_every_slice_on_a_command_line_exists(plan: Plan) -> None:
    for spec in plan.processes:
        for arg in spec.argv:
            if arg.startswith("{run}/slices/"):
                name = arg.removeprefix("{run}/slices/")
                assert plan.slices[name]["name"] == spec.name == name.removesuffix(".json")


def test_ports_are_those_of_the_architecture_page(plan: Plan) -> None:
    """Written out: the table in docs/architecture.md, not the code's own."""
    ports = {p.name: sorted(x.port for x in p.listens) for p in plan.processes}
    assert ports == {
        "world": [24010, 24012, 24014, 24020, 24022, 24024, 24030, 24032, 24034, 27002, 27004, 27006],
        "mocap": [1510],
        "forward.uav1": [24013],
        "forward.uav2": [24023],
        "router": [
            *(24000, 24011, 24016, 24017, 24018, 24021, 24026, 24028, 24031, 24036, 24038),
            *(27003, 27005, 27007),
        ],
        "sensors": [24003],
        "recorder": [24002],
        "program.uav1": [16001],
        "program.uav2": [17002],
        "tool.rec": [],
        "tool.uav3.view": [],
    }
    assert plan.land is not None and [x.port for x in plan.land.listens] == [24015, 24025, 24035]
    assert [(v.port, v.sdk_port, v.tools_port) for v in plan.vehicles][1] == (
        17002,
        23002,
        24026,
    )
    panic = plan.vehicles[0].panic
    assert (panic.autopilot_port, panic.partner_port, panic.autopilot_host) == (24014, 24015, "127.0.0.1")


def test_no_port_has_two_owners_in_the_largest_arena(tmp_path: Path) -> None:
    rows = [
        f"  v{i}: {{id: {i}, start: {{position: [{i}, 0, 0]}}}}\n" for i in range(1, LARGEST_VEHICLE_ID + 1)
    ]
    (tmp_path / "a.yaml").write_text("world: {size: [600, 4, 3]}\nvehicles:\n" + "".join(rows))
    plan = make_plan(load_arena(tmp_path / "a.yaml", ["sim.processes=many"]), "py")
    claimed = [x.port for p in (*plan.processes, plan.land) if p for x in p.listens]
    claimed += [p for v in plan.vehicles for p in (v.port, v.sdk_port)] + [1511, 14550]
    assert len(claimed) == len(set(claimed)) == LARGEST_VEHICLE_ID * 12 + 5


def test_two_ends_of_a_link_match(plan: Plan) -> None:
    world = {v["name"]: v["links"] for v in plan.slices["world.json"]["vehicles"]}
    rows = plan.slices["router.json"]["vehicles"]
    routed = {v["name"]: v["link"] for v in rows}
    for row in rows:
        ground = world[row["name"]]["ground"]
        assert (ground["local"], ground["remote"]) == (row["ground"]["remote"], row["ground"]["local"])
    for v in plan.vehicles:
        assert world[v.name]["router"] == {
            "local": routed[v.name]["remote"],
            "remote": routed[v.name]["local"],
        }
        assert world[v.name]["panic"]["remote"] == [v.panic.partner_host, v.panic.partner_port]
    forward = plan.slices["forward.uav1.json"]["link"]
    assert world["uav1"]["vision"] == {"local": forward["remote"], "remote": forward["local"]}


def test_router_serves_own_clients_and_all_ground_stations(plan: Plan) -> None:
    slice_ = plan.slices["router.json"]
    assert [g["address"] for g in slice_["gcs"]] == [
        ["127.0.0.1", 14550],
        ["10.0.0.5", 14550],
        ["10.0.0.6", 14550],
    ]
    assert (
        slice_["gcs_local"] == ["127.0.0.1", 24000]
        and slice_["heartbeat"] is True
        and slice_["simulated"] is True
    )
    clients = {v["name"]: [c["address"] for c in v["clients"]] for v in slice_["vehicles"]}
    assert clients["uav1"] == [
        ["127.0.0.1", 16001],
        ["127.0.0.1", 22001],
        ["10.0.0.5", 16001],
        ["10.0.0.5", 22001],
    ]
    assert clients["uav2"] == [["127.0.0.1", 17002], ["127.0.0.1", 23002]]
    assert slice_["vehicles"][0]["serve"] == ["127.0.0.1", 24018]
    assert slice_["recorder"] == ["127.0.0.1", 24002]


def test_slices_have_the_keys_that_processes_read(plan: Plan) -> None:
    world, mocap = plan.slices["world.json"], plan.slices["mocap.json"]
    assert world["vehicles"][1]["rpy"] == pytest.approx([0, 0, 1.5707963])
    assert world["vehicles"][1]["position"] == [-2.0, 0.0, 0.0]
    assert world["vehicles"][0]["params"]["EKF2_EV_DELAY"] == 11.0 and world["size_m"] == [7.0, 4.0, 3.0]
    assert world["vehicles"][0]["profile"]["thrust_curve"]["kind"] == "quadratic"
    assert mocap["bodies"][1] == {"name": "aero2", "number": 2, "index": 1}
    assert mocap["noise"]["position_m"] == pytest.approx(3e-4)
    program = plan.slices["program.uav1.json"]
    assert program["neighbours"] == [{"name": "uav2", "id": 2}] and program["capture"]["bodies"] == ["uav1"]
    assert program["link"] == "udpin:127.0.0.1:16001" and program["clock"] == "{rt}/clock"
    assert set(program["profile"]) == {
        "name",
        "mass_kg",
        "radius_m",
        "height_m",
        "num_rotors",
        "thrust_curve",
    }
    assert program["log"] == ["127.0.0.1", 24002]
    recorder = plan.slices["recorder.json"]
    assert (recorder["listen"], recorder["clock"], recorder["rate_hz"]) == (
        ["127.0.0.1", 24002],
        "{rt}/clock",
        30.0,
    )
    assert recorder["fence"] is None and recorder["foxglove"] is None
    shape = recorder["vehicles"][1].pop("shape")
    assert len(shape["rotors_m"]) == 4 and shape["radius_m"] > max(map(abs, shape["rotors_m"][0]))
    assert recorder["vehicles"][1] == {
        "name": "uav2",
        "id": 2,
        "body": "aero2",
        "index": 1,
        "autopilot": "builtin",
        "profile": plan.vehicles[1].profile,
        "serve": ["127.0.0.1", 24028],
        "tools": ["127.0.0.1", 24026],
    }
    assert "forward.uav3.json" not in plan.slices and plan.slices["forward.uav2.json"]["body"] == "aero2"


@pytest.mark.parametrize(("speed", "slow"), [("0.5", 2.0), ("0.05", 20.0), ("1", 1.0), ("max", 1.0)])
@pytest.mark.parametrize("processes", ["one", "many"])
def test_waits_for_simulated_vehicles_are_longer_in_a_slow_simulation(
    tmp_path: Path, speed: str, slow: float, processes: str
) -> None:
    (tmp_path / "arena.yaml").write_text("vehicles: {uav1: {autopilot: builtin}}\n")
    plan = make_plan(
        load_arena(tmp_path / "arena.yaml", [f"sim.speed={speed}", f"sim.processes={processes}"])
    )
    assert plan.slowdown == slow and Plan.from_json(plan.to_json()).slowdown == slow
    assert plan.land is not None and plan.land.argv[5:] == (
        ("--timeout", f"{60 * slow:g}") if slow > 1 else ()
    )
    limits = {spec.name: spec.start_timeout_s for spec in plan.processes}
    assert limits["world"] == 60.0 * slow and limits.get("router", 30.0 * slow) == 30.0 * slow
