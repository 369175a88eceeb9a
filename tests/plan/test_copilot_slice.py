"""The copilot in the plan: its slice, who needs it, where programs beat; and its section of the YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from arena.cli._arena import copilot_notes
from arena.errors import InputError
from arena.plan import Plan, ProcessSpec, make_plan
from arena.schema import load_arena

TWO = """\
vehicles:
  uav1: {program: hover.py, params: {MPC_ACC_HOR: 2.5}}
  uav2: {start: {position: [-2, 0, 0]}}
"""


def planned(folder: Path, copilot: str, vehicles: str = TWO) -> Plan:
    (folder / "hover.py").touch()
    (folder / "arena.yaml").write_text(copilot + "\n" + vehicles)
    return make_plan(load_arena(folder / "arena.yaml"), "py")


def process(plan: Plan, name: str) -> ProcessSpec:
    return {p.name: p for p in plan.processes}[name]


def test_without_the_section_there_is_none(tmp_path: Path) -> None:
    plan = planned(tmp_path, "")
    assert "copilot.json" not in plan.slices and plan.slices["program.uav1.json"]["heartbeat"] is None
    assert all("copilot" not in p.needs for p in plan.processes)


def test_an_empty_section_is_all_its_defaults(tmp_path: Path) -> None:
    plan = planned(tmp_path, "copilot: {}")
    made = plan.slices["copilot.json"]
    assert made["listen"] == plan.slices["program.uav1.json"]["heartbeat"] == ["127.0.0.1", 24001]
    assert made["rules"]["separation"] == {"do": "hold", "at_m": 0.8, "ahead_s": 3.0}
    assert made["at_most"] == "land" and made["clock"] == "{rt}/clock" and len(made["captures"]) == 1
    one, two = made["vehicles"]
    assert (
        one["braking"] == {"accel": 2.5, "jerk": 4.0, "up": 3.0, "down": 4.0}
        and two["braking"]["accel"] == 3.0
    )
    assert one["tools"] == ["127.0.0.1", 24016] and one["panic"] == ["127.0.0.1", 24014]


def test_the_copilots_fence_is_the_arenas_else_the_walls_less_the_vehicles_size(tmp_path: Path) -> None:
    walls = planned(tmp_path, "copilot: {}\nworld: {size: [10, 6, 3]}").slices["copilot.json"]["vehicles"][0][
        "fence"
    ]
    radius = load_arena(tmp_path / "arena.yaml").vehicles[0].profile.radius_m
    assert (
        walls["north"] == [-5 + radius, 5 - radius]
        and walls["east"] == [-3 + radius, 3 - radius]
        and walls["up"] < 3
    )
    fence = "copilot: {}\nworld: {size: [10, 6, 3]}\ngeofence: {margin_m: 0.5}"
    drawn = planned(tmp_path, fence).slices["copilot.json"]["vehicles"][0]["fence"]
    assert drawn == {"north": [-4.5, 4.5], "east": [-2.5, 2.5], "up": 2.5}


@pytest.mark.parametrize(
    ("on_loss", "needed", "restart"),
    [("land", True, "never"), ("restart", True, "on_failure"), ("warn", False, "never")],
)
def test_on_loss_is_who_needs_it_and_whether_it_comes_again(
    tmp_path: Path, on_loss: str, needed: bool, restart: str
) -> None:
    plan = planned(tmp_path, f"copilot: {{on_loss: {on_loss}}}")
    assert process(plan, "copilot").restart.mode == restart
    assert ("copilot" in process(plan, "program.uav1").needs) is needed
    assert "copilot" not in process(plan, "recorder").needs
    alone = planned(tmp_path, f"copilot: {{on_loss: {on_loss}}}", "vehicles: {uav1: {}}")
    assert ("copilot" in process(alone, "recorder").needs) is needed, (
        "without programs another process needs it, so that its loss ends the run"
    )


def test_it_outlives_its_supervisor_and_says_what_it_binds(tmp_path: Path) -> None:
    spec = process(planned(tmp_path, "copilot: {}"), "copilot")
    assert spec.outlives and spec.kind == "copilot" and [x.port for x in spec.listens] == [24001]


def test_the_resolved_yaml_has_it_too(tmp_path: Path) -> None:
    plan = planned(tmp_path, "copilot: {tilt: {do: none}}")
    again = tmp_path / "again"
    again.mkdir()
    (again / "arena.yaml").write_text(plan.yaml)
    assert (
        make_plan(load_arena(again / "arena.yaml"), "py").slices["copilot.json"]
        == plan.slices["copilot.json"]
    )


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("", "copilot: has nothing below it. Write `copilot: {}`"),
        (
            "{tilt: {do: terminate}}",
            "copilot: expected tilt.do no stronger than at_most, got tilt.do: terminate",
        ),
        ("{at_most: hold}", "copilot: expected tilt.do no stronger than at_most, got tilt.do: land"),
        ("{separation: {at_m: 0}}", "copilot.separation.at_m"),
        ("{geofense: {}}", "geofence"),
        ("{tilt: {do: fall}}", "copilot.tilt.do"),
    ],
)
def test_what_is_wrong_in_it_is_said(tmp_path: Path, section: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        planned(tmp_path, f"copilot: {section}")
    assert said in str(caught.value)


def notes(folder: Path, text: str) -> list[str]:
    (folder / "arena.yaml").write_text(text)
    return copilot_notes(load_arena(folder / "arena.yaml"))


def test_hardware_without_a_copilot_gives_a_note(tmp_path: Path) -> None:
    real: dict[str, Any] = {"url": "udpin:0.0.0.0:14550"}
    text = "mocap: {source: natnet, server: 10.0.0.5}\nvehicles:\n"
    text += f"  uav1: {{autopilot: hardware, profile: iris, radio: none, url: '{real['url']}'}}\n"
    assert notes(tmp_path, text) == ["uav1: real vehicles without a copilot: add `copilot: {}` to the YAML"]
    assert notes(tmp_path, "copilot: {}\n" + text) == []
    assert notes(tmp_path, "vehicles: {uav1: {}}") == []


def test_vehicles_that_start_too_close_are_named(tmp_path: Path) -> None:
    near = "vehicles: {uav1: {}, uav2: {start: {position: [0.7, 0, 0]}}}"
    (said,) = notes(tmp_path, "copilot: {}\n" + near)
    assert said == "uav1 and uav2 start 0.70 m apart, and copilot.separation.at_m is 0.8: uav2 will be held"
    assert notes(tmp_path, "copilot: {separation: {at_m: 0.6}}\n" + near) == []
    assert notes(tmp_path, near) == []
