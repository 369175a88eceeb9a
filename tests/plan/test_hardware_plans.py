"""Plans with real vehicles: hardware beside simulated ones, hardware alone, a controller in the loop."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.plan import Plan, make_plan
from arena.schema import Arena, load_arena
from arena.supervisor.run_folder import _LONGEST_SOCKET

MIXED = """
mocap: {source: natnet, server: 10.0.0.5, local: 10.0.0.2, version: "4.1", rate_hz: 120}
preflight: {position_m: 0.3}
defaults: {profile: iris, radio: none}
vehicles:
  real: {id: 7, autopilot: hardware, url: "udpin:0.0.0.0:14540", neighbours: [sim], program: fly.py, params: {COM_OF_LOSS_T: 0.5}}
  sim: {autopilot: builtin, neighbours: [real], program: fly.py}
"""
LOOP = "vehicles:\n  board: {id: 3, autopilot: hitl, serial: /dev/ttyACM0}\n"


def arena_of(text: str, folder: Path) -> Arena:
    (folder / "fly.py").touch()
    (folder / "arena.yaml").write_text(text)
    return load_arena(folder / "arena.yaml")


@pytest.fixture
def mixed(tmp_path: Path) -> Plan:
    return make_plan(arena_of(MIXED, tmp_path))


def test_hardware_has_a_link_in_place_of_its_autopilot(mixed: Plan) -> None:
    link, router, forward = (mixed.slices[f"{name}.json"] for name in ("link.real", "router", "forward.real"))
    assert link["wire"] == {"kind": "udpin", "address": ["0.0.0.0", 14540]} and link["simulator"] is None
    assert link["links"]["vision"] == {"local": forward["link"]["remote"], "remote": forward["link"]["local"]}
    routed = {v["name"]: v for v in router["vehicles"]}
    assert link["links"]["router"]["local"] == routed["real"]["link"]["remote"]
    assert (routed["real"]["simulated"], routed["sim"]["simulated"]) == (False, True) and router[
        "simulated"
    ] is False


def test_programs_wait_only_for_programs_with_the_same_clock(tmp_path: Path) -> None:
    more = 'two: {id: 9, autopilot: hardware, url: "udpin:0.0.0.0:14541", program: fly.py}\n'
    slices = make_plan(arena_of(f"{MIXED}  {more}", tmp_path)).slices
    assert slices["program.real.json"]["programs"] == ["real", "two"]
    assert slices["program.sim.json"]["programs"] == ["sim"]


@pytest.mark.parametrize(
    ("more", "needs"),
    [
        ("", False),
        ("failsafe: {data_link_loss: {action: land}}\n", True),
        ("preflight: {params: false}\n", True),
    ],
)
def test_heartbeat_of_the_router_must_not_disable_a_data_link_failsafe(
    tmp_path: Path, more: str, needs: bool
) -> None:  # review fault 20
    text = MIXED.replace("preflight: {position_m: 0.3}\n", more)
    routed = make_plan(arena_of(text, tmp_path)).slices["router.json"]["vehicles"]
    assert {v["name"]: v["needs_operator"] for v in routed} == {"real": needs, "sim": False}


def test_world_and_emulator_have_only_simulated_vehicles(mixed: Plan) -> None:
    assert [v["name"] for v in mixed.slices["world.json"]["vehicles"]] == ["sim"]
    assert mixed.slices["mocap.json"]["bodies"] == [{"name": "sim", "number": 1, "index": 0}]
    recorded = mixed.slices["recorder.json"]["vehicles"]
    assert {v["name"]: v["index"] for v in recorded} == {"real": None, "sim": 0}


def test_each_vehicle_is_seen_by_its_own_cameras(mixed: Plan) -> None:
    real, sim = mixed.slices["forward.real.json"]["capture"], mixed.slices["forward.sim.json"]["capture"]
    assert (real["server"], real["local"], real["group"]) == ("10.0.0.5", "10.0.0.2", "239.255.42.99")
    assert (sim["server"], sim["local"]) == ("127.0.0.1", "127.0.0.1")
    assert mixed.slices["program.real.json"]["capture"]["bodies"] == ["real"]
    seen = mixed.slices["sensors.json"]["captures"]
    assert [(c["server"], c["bodies"], c["simulated"]) for c in seen] == [
        ("127.0.0.1", ["sim"], True),
        ("10.0.0.5", ["real"], False),
    ]


def test_emulator_does_not_use_the_group_of_a_real_server(tmp_path: Path) -> None:
    plan = make_plan(arena_of(MIXED.replace("local:", "group: 239.1.2.3, local:"), tmp_path))
    assert (
        plan.slices["forward.real.json"]["capture"]["group"]
        == "239.1.2.3"
        != plan.slices["mocap.json"]["group"]
    )


def test_hardware_runs_on_the_wall_clock(mixed: Plan) -> None:
    for room in ("forward", "program"):
        assert mixed.slices[f"{room}.real.json"]["clock"] is None, room
        assert mixed.slices[f"{room}.sim.json"]["clock"] == "{rt}/clock", room
    recorder = mixed.slices["recorder.json"]
    assert (recorder["clock"], recorder["truth"]) == (None, "{rt}/truth")
    assert [(c["server"], c["simulated"]) for c in recorder["captures"]] == [
        ("127.0.0.1", True),
        ("10.0.0.5", False),
    ]
    assert {v.name: v.simulated for v in mixed.vehicles} == {"real": False, "sim": True}


def test_fault_injection_needs_an_arena_without_hardware(mixed: Plan, tmp_path: Path) -> None:
    simulated = make_plan(arena_of("vehicles: {one: {autopilot: builtin}}\n", tmp_path))
    for room in ("world", "mocap", "router"):
        assert simulated.slices[f"{room}.json"]["faults"] == f"{{rt}}/{room}.faults"
        assert mixed.slices[f"{room}.json"]["faults"] is None
        assert len(f"/{room}.faults") <= len(_LONGEST_SOCKET), (
            "or a run's folder may be too long a path for it"
        )
    assert (
        simulated.slices["router.json"]["clock"] == "{rt}/clock"
        and mixed.slices["router.json"]["clock"] is None
    )
    assert simulated.slices["router.json"]["seed"] == 1


def test_hardware_must_hold_all_parameters_or_those_of_the_yaml(mixed: Plan, tmp_path: Path) -> None:
    asked = mixed.slices["link.real.json"]["params"]
    assert (
        asked["COM_OF_LOSS_T"] == 0.5
        and asked["COM_OBL_RC_ACT"] == 4.0
        and not [k for k in asked if k.startswith("CA_")]
    )
    without = MIXED.replace("preflight: {", "preflight: {params: false, ")
    alone = make_plan(arena_of(without, tmp_path))
    assert alone.slices["link.real.json"]["params"] == {"COM_OF_LOSS_T": 0.5}
    assert mixed.slices["link.real.json"]["preflight"]["position_m"] == 0.3
    (tmp_path / "lab.params").write_text(
        "1\t1\tCOM_OF_LOSS_T\t1.5\t9\n1\t1\tEKF2_HGT_REF\t3\t6\n1\t1\tMAV_SYS_ID\t1\t6\n"
    )
    plan = make_plan(arena_of(without.replace("id: 7,", "id: 7, params_file: lab.params,"), tmp_path))
    assert plan.slices["link.real.json"]["params"] == {"COM_OF_LOSS_T": 0.5, "EKF2_HGT_REF": 3.0}


def test_params_file_replaces_rules_and_yields_to_the_yaml(
    tmp_path: Path,
) -> None:
    (tmp_path / "lab.params").write_text("# saved\nCOM_OBL_RC_ACT 3\nMPC_XY_VEL_MAX 2.5\n")
    text = "vehicles:\n  a: {autopilot: builtin, params_file: lab.params, params: {MPC_XY_VEL_MAX: 4}}\n"
    params = make_plan(arena_of(text, tmp_path)).slices["world.json"]["vehicles"][0]["params"]
    assert (params["COM_OBL_RC_ACT"], params["MPC_XY_VEL_MAX"]) == (3.0, 4.0)


def test_arena_without_simulated_vehicles_has_no_world(tmp_path: Path) -> None:
    alone = MIXED.replace("  sim: {autopilot: builtin, neighbours: [real], program: fly.py}\n", "")
    text = alone.replace("neighbours: [sim], ", "")
    names = [p.name for p in make_plan(arena_of(text, tmp_path)).processes]
    assert names == ["link.real", "forward.real", "router", "recorder", "program.real"]


def test_hardware_has_a_longer_start_timeout(mixed: Plan) -> None:
    patience = {p.name: p.start_timeout_s for p in mixed.processes}
    assert patience["link.real"] == patience["forward.real"] == 600.0 > patience["forward.sim"]


def test_hitl_vehicle_has_a_body_and_a_link_to_the_simulator_port(
    tmp_path: Path,
) -> None:
    plan = make_plan(arena_of(LOOP, tmp_path))
    world, link = plan.slices["world.json"]["vehicles"][0], plan.slices["link.board.json"]
    assert link["simulator"] == world["simulator"] == ["127.0.0.1", 24039] and "links" not in world
    assert link["wire"] == {"kind": "serial", "device": "/dev/ttyACM0", "baud": 921600}
    wanted = {
        "SYS_HITL": 1,
        "HIL_ACT_FUNC1": 101,
        "HIL_ACT_FUNC4": 104,
        "EKF2_EV_CTRL": 15,
        "CA_ROTOR_COUNT": 4,
        "MAV_SYS_ID": 3,
    }
    assert wanted.items() <= link["params"].items()
    assert [p.name for p in plan.processes][:3] == ["world", "mocap", "link.board"] and plan.vehicles[
        0
    ].simulated


@pytest.mark.parametrize("text", [MIXED, LOOP], ids=["mixed", "hitl"])
def test_resolved_yaml_gives_the_same_plan(text: str, tmp_path: Path) -> None:
    arena = arena_of(text, tmp_path)
    (tmp_path / "again.yaml").write_text(make_plan(arena).yaml)
    again = load_arena(tmp_path / "again.yaml")
    assert (
        make_plan(again).slices == make_plan(arena).slices
        and make_plan(again).processes == make_plan(arena).processes
    )
