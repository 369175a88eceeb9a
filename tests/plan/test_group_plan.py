"""Plan of groups, whose programs run in one process, and of ranges of vehicles."""

from __future__ import annotations

import re

import pytest

from arena.errors import InputError
from arena.plan import Plan, make_plan
from arena.schema import load_arena

FOUR = "vehicles:\n  uav1..uav4: {start: {position: [2, -1, 0], grid: {columns: 2, spacing_m: 1.5}}, program: %s}\n"
GROUP = FOUR % "{path: fly.py, group: show}"
HARDWARE = "autopilot: hardware, profile: iris, url: 'udpin:127.0.0.1:14600', radio: none"


def plan_of(folder, text: str, *sets: str) -> Plan:
    for name in ("fly.py", "other.py"):
        (folder / name).touch()
    (folder / "fly.sh").touch(mode=0o755)
    (folder / "arena.yaml").write_text(text)
    return make_plan(load_arena(folder / "arena.yaml", ["defaults.autopilot=builtin", *sets]))


def test_group_is_one_process_with_a_member_per_vehicle(tmp_path):
    plan = plan_of(tmp_path, GROUP)
    group = next(p for p in plan.processes if p.name == "group.show")
    assert not [p.name for p in plan.processes if p.kind == "program"]
    assert group.flies == ("uav1", "uav2", "uav3", "uav4") and group.is_program
    assert [m.name for m in group.members] == [f"program.uav{i}" for i in range(1, 5)]
    assert sorted(x.port for x in group.listens) == [16001, 16002, 16003, 16004]
    assert {f"forward.uav{i}" for i in range(1, 5)} < set(group.needs) and "router" in group.needs
    made = plan.slices["group.show.json"]
    assert made["members"][2] == {"vehicle": "uav3", "argv": ["--uav", "{run}/slices/program.uav3.json"]}
    assert (made["once"], made["program"]) == (False, str(tmp_path / "fly.py"))
    assert Plan.from_json(plan.to_json()) == plan


def test_fused_world_waits_for_the_group_and_not_for_its_vehicles(tmp_path):
    plan = plan_of(tmp_path, GROUP, "sim.speed=max")
    assert plan.slices["world.json"]["expected"] == ["group.show"]
    assert [p.name for p in plan.processes] == ["world", "group.show"]


def test_vehicles_of_a_range_start_in_a_grid(tmp_path):
    (tmp_path / "fly.py").touch()
    (tmp_path / "arena.yaml").write_text(GROUP)
    arena = load_arena(tmp_path / "arena.yaml", ["vehicles.uav2.mass_kg=1.6"])
    places = [v.position for v in arena.vehicles]
    assert places == [(2.0, -1.0, 0.0), (2.0, 0.5, 0.0), (0.5, -1.0, 0.0), (0.5, 0.5, 0.0)]
    assert [v.profile.mass_kg for v in arena.vehicles] == [1.52, 1.6, 1.52, 1.52]


def test_resolved_yaml_of_a_range_gives_the_same_plan(tmp_path):
    plan = plan_of(tmp_path, GROUP)
    (tmp_path / "again.yaml").write_text(plan.yaml)
    again = make_plan(load_arena(tmp_path / "again.yaml"))
    assert again.slices["group.show.json"] == plan.slices["group.show.json"]
    assert again.slices["world.json"] == plan.slices["world.json"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (FOUR % "{path: fly.py, run: once}", "uav1.program.run: got once, but the program has no group"),
        (FOUR % "{path: fly.sh, group: show}", "program of the group show is fly.sh, expected a Python file"),
        (
            FOUR % "{path: fly.py, group: show, restart: on_failure}",
            "got on_failure, but the programs of the group show",
        ),
        (
            "vehicles:\n  uav1: {program: {path: fly.py, group: show}}\n"
            "  uav2: {start: {position: [1, 0, 0]}, program: {path: other.py, group: show}}\n",
            r"uav2.program.path: the group show has \S*other.py here and \S*fly.py at uav1",
        ),
        (
            "vehicles:\n  uav1: {program: {path: fly.py, group: show}}\n"
            f"  uav2: {{{HARDWARE}, program: {{path: fly.py, group: show}}}}\n",
            "uav2 is real, but uav1 of the same group show is simulated",
        ),
        ("vehicles:\n  uav1: {start: {grid: {columns: 2}}}\n", "uav1.start.grid: is for a range"),
        ("vehicles:\n  uav4..uav1: {}\n", "expected a range such as uav1..uav48"),
        ("vehicles:\n  uav1..drone4: {}\n", "expected a range such as uav1..uav48"),
        ("vehicles:\n  uav1..uav4: {}\n  uav3: {}\n", "uav3 is given twice"),
    ],
)
def test_wrong_groups_and_ranges_are_refused(tmp_path, text, said):
    with pytest.raises(InputError) as error:
        plan_of(tmp_path, text)
    assert re.search(said, str(error.value)), str(error.value)
