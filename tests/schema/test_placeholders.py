"""Placeholders in the arguments of programs and tools, and the environment variables with the same values."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from arena.errors import InputError
from arena.plan import Plan, make_plan
from arena.schema import load_arena
from arena.schema.placeholders import PLACEHOLDERS, variable
from arena.supervisor.run_folder import RunFolder

ARENA = """
address: 127.0.0.3
defaults: {autopilot: builtin}
vehicles:
  uav1: {program: {path: fly, args: %s}, neighbours: [uav2]}
  uav2: {start: {position: [1, 0, 0]}, mass_kg: 1.25, program: {path: fly, args: %s}, mocap_body: two, tools: {watch: {argv: %s}}}
tools: {log: {argv: %s, env: {WHERE: '{run}'}}}
"""


def plan_of(folder: Path, args: list[str], tool: tuple[str, ...] = ("true",), *sets: str) -> Plan:
    (folder / "fly").touch(mode=0o755)
    words = json.dumps(args)
    (folder / "arena.yaml").write_text(ARENA % (words, words, json.dumps([*tool]), '["true"]'))
    return make_plan(load_arena(folder / "arena.yaml", sets))


def process(plan: Plan, name: str):
    return next(p for p in plan.processes if p.name == name)


def args_of(plan: Plan, name: str) -> tuple[str, ...]:
    return process(plan, name).argv[1:]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{name}/{ns}", "uav2/uav2"),
        ("{id}", "2"),
        ("{mavlink_url}", "udpin:127.0.0.3:16002"),
        ("{sdk_url}", "udpin://127.0.0.3:22002"),
        ("{mavros_url}", "udp://127.0.0.3:16002@127.0.0.3:24028"),
        ("{tools_url}", "udpout:127.0.0.3:24026"),
        ("--mass={mass_kg}kg", "--mass=1.25kg"),
        ("{body} {mocap_vendor}:{mocap_address}", "two natnet:127.0.0.3"),
        ("{autopilot} {simulated} {num_rotors}", "builtin true 4"),
        ("{uav_file}", "{run}/slices/program.uav2.json"),
    ],
)
def test_placeholder_has_the_value_of_its_own_vehicle(tmp_path, text, expected):
    assert args_of(plan_of(tmp_path, [text]), "program.uav2") == (expected,)


def test_every_placeholder_has_a_text_and_is_in_the_environment(tmp_path):
    plan = plan_of(tmp_path, [f"{{{name}}}" for name in PLACEHOLDERS])
    values = dict(zip(PLACEHOLDERS, args_of(plan, "program.uav1"), strict=True))
    env = dict(process(plan, "program.uav1").env)
    assert values["neighbours"] == "uav2" and values["clock"] == "{rt}/clock"
    assert {name: env[variable(name)] for name in values if variable(name) in env} == {
        name: text for name, text in values.items() if name not in ("run", "rt")
    }


def test_variables_do_not_replace_those_of_the_supervisor():
    taken = {
        "ARENA_FD",
        "ARENA_RUN",
        "ARENA_PROCESS",
        "ARENA_GROUP",
        "ARENA_RUNTIME_DIR",
        "ARENA_INTERPRETED",
    }
    assert not taken & {variable(name) for name in PLACEHOLDERS} - {"ARENA_RUN"}


@pytest.mark.parametrize("text", ['{"a": 1}', "{}", "${HOME}", "{Name}", "a{b", "{1}", "{ name }"])
def test_other_braces_are_text(tmp_path, text):
    plan = plan_of(tmp_path, [text])
    assert filled(plan, tmp_path) == (text,)


@pytest.mark.parametrize("name", ["name", "run", "rt", "brace", "nothing"])
def test_double_braces_stand_for_the_text(tmp_path, name):
    assert filled(plan_of(tmp_path, [f"x{{{{{name}}}}}y"]), tmp_path) == (f"x{{{name}}}y",)


def filled(plan: Plan, folder: Path) -> tuple[str, ...]:
    """Return the arguments of the program of uav1 as the supervisor passes them."""
    run = RunFolder(path=folder / "the run", rt=folder / "rt")
    return run.spec(process(plan, "program.uav1")).argv[1:]


def test_run_folder_is_filled_in_by_the_supervisor(tmp_path):
    assert filled(plan_of(tmp_path, ["{run}/x"]), tmp_path) == (f"{tmp_path}/the run/x",)


def test_unknown_placeholder_is_refused_with_the_names_that_exist(tmp_path):
    with pytest.raises(InputError) as caught:
        plan_of(tmp_path, ["{mavlnk_url}"])
    message = str(caught.value)
    assert "arena.yaml:5: vehicles.uav1.args: got {mavlnk_url}" in message
    assert "Did you mean mavlink_url?" in message and "{{mavlnk_url}}" in message
    assert all(name in message for name in PLACEHOLDERS)


def test_tool_of_a_vehicle_has_the_values_of_the_vehicle(tmp_path):
    spec = process(plan_of(tmp_path, [], ("watch", "{tools_url}")), "tool.uav2.watch")
    assert spec.argv == ("watch", "udpout:127.0.0.3:24026") and dict(spec.env)["ARENA_ID"] == "2"


def test_tool_of_the_arena_has_no_values_of_a_vehicle(tmp_path):
    env = dict(process(plan_of(tmp_path, []), "tool.log").env)
    assert env["WHERE"] == "{run}" and env["ARENA_ADDRESS"] == "127.0.0.3" and "ARENA_ID" not in env
    (tmp_path / "arena.yaml").write_text("vehicles: {uav1: {}}\ntools: {log: {argv: [echo, '{id}']}}\n")
    with pytest.raises(InputError, match="belongs to one vehicle, but this tool belongs to the whole arena"):
        load_arena(tmp_path / "arena.yaml")


def test_executable_gets_only_its_arguments(tmp_path):
    spec = process(plan_of(tmp_path, ["a"]), "program.uav1")
    assert spec.argv == (str(tmp_path / "fly"), "a") and spec.cwd == str(tmp_path)
    assert dict(spec.env)["ARENA_UAV_FILE"] == "{run}/slices/program.uav1.json"


def test_resolved_yaml_has_the_same_arguments(tmp_path):
    plan = plan_of(tmp_path, ["{mass_kg}", "{{run}}"])
    again = tmp_path / "again"
    again.mkdir()
    (again / "arena.yaml").write_text(plan.yaml)
    assert args_of(make_plan(load_arena(again / "arena.yaml")), "program.uav1") == args_of(
        plan, "program.uav1"
    )


# -- time of executables


@pytest.mark.parametrize("speed", ["max", "4"])
def test_arena_with_a_wall_clock_program_runs_at_speed_1(tmp_path, speed):
    from arena.cli._arena import clock_notes

    plan_of(tmp_path, [])
    arena = load_arena(tmp_path / "arena.yaml", [f"sim.speed={speed}"])
    assert (
        arena.sim.speed == 1.0
        and "the program of uav1 uses the wall clock" in arena.origins["sim.speed"].source
    )
    (note,) = clock_notes(arena)
    assert note.startswith(f"sim.speed is 1 instead of {speed}") and "clock: simulation" in note
    assert clock_notes(load_arena(tmp_path / "arena.yaml")) == []


def test_program_that_follows_simulation_time_keeps_the_speed(tmp_path):
    plan_of(tmp_path, [])
    sets = [f"vehicles.{v}.program.clock=simulation" for v in ("uav1", "uav2")]
    assert load_arena(tmp_path / "arena.yaml", [*sets, "sim.speed=max"]).sim.speed == "max"
    assert load_arena(tmp_path / "arena.yaml", [sets[0], "sim.speed=max"]).sim.speed == 1.0


def test_python_program_can_use_the_wall_clock(tmp_path):
    (tmp_path / "sdk.py").touch()
    (tmp_path / "arena.yaml").write_text("vehicles: {uav1: {program: sdk.py}}")
    assert load_arena(tmp_path / "arena.yaml", ["sim.speed=max"]).sim.speed == "max"
    (tmp_path / "arena.yaml").write_text("vehicles: {uav1: {program: {path: sdk.py, clock: wall}}}")
    assert load_arena(tmp_path / "arena.yaml", ["sim.speed=max"]).sim.speed == 1.0


def test_executable_is_run_by_its_path(tmp_path):
    assert os.access(tmp_path, os.X_OK)
    plan_of(tmp_path, [])
    (tmp_path / "fly").chmod(0o644)
    with pytest.raises(InputError, match="chmod"):
        load_arena(tmp_path / "arena.yaml")
