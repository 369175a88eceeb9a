"""Loading scenario files: each problem is one line with its place; several problems give several lines."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from arena.errors import InputError
from arena.schema import load_arena
from arena.schema.descriptions import descriptions
from arena.smoke.language.model import Box
from arena.smoke.language.scenario import load_scenarios
from arena.smoke.language.scenario_file import ScenarioFile

TWO = "vehicles:\n  uav1: {program: fly.py}\n  uav2: {start: {position: [2, 0, 0]}}\n"
ONE = "vehicles:\n  uav1: {program: fly.py}\n"
HEAD = "arena: two.yaml\n"
STEP = "steps:\n  - at: uav1.airborne\n    do: kill program uav1\n"

# name of the problem -> (YAML, `line: field: ` of the message, words in the message)
BROKEN: dict[str, tuple[str, str, str]] = {
    "unknown key": (
        HEAD + "tim_limit_s: 3\n" + STEP,
        "2: tim_limit_s: ",
        "unknown key. Did you mean time_limit_s?",
    ),
    "key given twice": (HEAD + HEAD + STEP, "2: arena: ", "twice, on lines 1 and 2"),
    "no arena": (STEP, "1: arena: ", "is missing"),
    "no steps": (HEAD, "1: steps: ", "is missing"),
    "empty steps": (HEAD + "steps: []\n", "2: steps: ", "at least 1"),
    "steps as text": (HEAD + "steps: kill all\n", "2: steps: ", "got 'kill all', expected a list."),
    "arena as a number": (
        "arena: 3\n" + STEP,
        "1: arena: ",
        "got 3, expected the path of an arena's YAML, a list of such paths, or a mapping",
    ),
    "empty list of arenas": ("arena: []\n" + STEP, "1: arena: ", "expected the path of an arena's YAML"),
    "arena that is not there": (
        "arena: tow.yaml\n" + STEP,
        "1: arena: ",
        "got 'tow.yaml', which does not exist. Did you mean two.yaml?",
    ),
    "arena of another folder that is not there": (
        "arena: ../x/two.yaml\n" + STEP,
        "1: arena: ",
        "which does not exist",
    ),
    "time limit of nothing": (
        HEAD + "time_limit_s: 0\n" + STEP,
        "2: time_limit_s: ",
        "got 0, expected more than 0.",
    ),
    "time limit as text": (
        HEAD + "time_limit_s: 60 s\n" + STEP,
        "2: time_limit_s: ",
        "got '60 s', expected a number.",
    ),
    "override that is none": (HEAD + "set: [defaults]\n" + STEP, "2: set[0]: ", "expected key=value"),
    "override of an unknown key": (
        HEAD + "set:\n  - world.seed=3\n  - world.sede=3\n" + STEP,
        "4: set[1]: ",
        "world.sede: unknown key. Did you mean seed?",
    ),
    "override with a wrong value": (
        HEAD + "set: [sim.speed=fast]\n" + STEP,
        "2: set[0]: ",
        "sim.speed: got 'fast'",
    ),
    "override that suits no vehicle": (
        HEAD + "set: [defaults.pose_rate_hz=70]\n" + STEP,
        "2: set[0]: ",
        "pose_rate_hz: got 70",
    ),
    "step as text": (
        HEAD + "steps:\n  - kill all\n",
        "3: steps[0]: ",
        "got 'kill all', expected a mapping of at, do, expect.",
    ),
    "empty step": (HEAD + "steps:\n  - {}\n", "3: steps[0]: ", "expected a mapping of at, do, expect."),
    "unknown key of a step": (
        HEAD + STEP + "  - expct: uav1.landed within 2 s\n",
        "5: steps[1].expct: ",
        "unknown key. Did you mean expect?",
    ),
    "action as a number": (HEAD + "steps:\n  - do: 3\n", "3: steps[0].do: ", "got 3, expected text."),
    "one of several actions": (
        HEAD + "steps:\n  - do:\n      - land all\n      - lnd all\n",
        "5: steps[0].do[1]: ",
        "Did you mean land?",
    ),
    "no action": (HEAD + "steps:\n  - do: []\n", "3: steps[0].do: ", "expected text"),
    "two triggers": (
        HEAD + "steps:\n  - at: [start, start]\n    do: land all\n",
        "3: steps[0].at: ",
        "expected text",
    ),
    "trigger misspelt": (
        HEAD + "steps:\n  - at: uav1.airbrne + 3 s\n    do: land all\n",
        "3: steps[0].at: ",
        "Did you mean uav1.airborne?",
    ),
    "vehicle that is not there": (
        HEAD + "steps:\n  - at: uav3.airborne\n    do: land all\n",
        "3: steps[0].at: ",
        "expected a vehicle of the arena, or each",
    ),
    "action on a vehicle that is not there": (
        HEAD + "steps:\n  - do: rc loss uav3\n",
        "3: steps[0].do: ",
        "got 'uav3' after 'loss'",
    ),
    "program that is not there": (
        HEAD + "steps:\n  - do: kill program uav2\n",
        "3: steps[0].do: ",
        "no process program.uav2",
    ),
    "PX4 that is not there": (
        HEAD + "steps:\n  - do: hang px4 uav1\n",
        "3: steps[0].do: ",
        "no process px4.uav1",
    ),
    "rotor that is not there": (
        HEAD + "steps:\n  - do: motor loss uav1 rotor 5\n",
        "3: steps[0].do: ",
        "the number of a rotor, 1 to 4",
    ),
    "expectation without a time": (
        HEAD + STEP + "  - expect: uav1.landed\n",
        "5: steps[1].expect: ",
        "`within` a time, or `for` a time",
    ),
    "mode that is none": (
        HEAD + STEP + "  - expect: uav1.mode == LADN within 2 s\n",
        "5: steps[1].expect: ",
        "Did you mean LAND?",
    ),
    "one of several expectations": (
        HEAD + STEP + "    expect:\n      - uav1.landed within 2 s\n      - uav1.landed wihtin 2 s\n",
        "7: steps[0].expect[1]: ",
        "Did you mean within?",
    ),
    "rule misspelt": (
        HEAD + STEP + "always:\n  - separation > 0.8 m\n  - inside geofnce\n",
        "7: always[1]: ",
        "got 'geofnce' after 'inside', expected geofence. Did you mean geofence?",
    ),
    "rule with the wrong unit": (
        HEAD + STEP + "always: [uav1.tilt < 40 m]\n",
        "5: always[0]: ",
        "expected the unit deg",
    ),
    "rule as a mapping": (
        HEAD + STEP + "always:\n  - separation: 3\n",
        "6: always[0]: ",
        "got a mapping, expected text.",
    ),
    "rules as text": (HEAD + STEP + "always: inside geofence\n", "5: always: ", "expected a list"),
    "separation of one": (
        "arena: one.yaml\n" + STEP + "always: [separation > 1 m]\n",
        "5: always[0]: ",
        "only one vehicle",
    ),
    "what may happen misspelt": (HEAD + "may: [crsh uav1]\n" + STEP, "2: may[0]: ", "Did you mean crash?"),
    "what may happen to nobody": (HEAD + "may: [crash]\n" + STEP, "2: may[0]: ", "got nothing after 'crash'"),
    "hardware": (
        "arena: {vehicles: {uav1: {autopilot: hardware, profile: iris, radio: none, url: 'udpin:127.0.0.1:14600'}}}\n"
        + "steps: [do: land all]\n",
        "1: ",
        "uav1",
    ),
    "fault of the arena inside": (
        "arena:\n  vehicles:\n    uav1: {prgram: fly.py}\n" + STEP,
        "3: arena.vehicles.uav1.prgram: ",
        "unknown key. Did you mean program?",
    ),
    "an empty file": ("# nothing\n", "", "s.yaml: is empty. Start with `arena:` and `steps:`"),
    "an arena": (
        "name: lab\n" + TWO,
        "2: ",
        "got an arena, expected a scenario: write a file with `arena: s.yaml` and `steps:`",
    ),
    "copilot that is not there": (
        HEAD + "steps: [do: kill copilot]\n",
        "2: steps[0].do: ",
        "expected a process of the arena (the arena has no copilot)",
    ),
    "no mapping": ("- 3\n", "1: ", "expected"),
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.yaml").write_text(TWO)
    (tmp_path / "one.yaml").write_text(ONE)
    (tmp_path / "fly.py").touch()
    return tmp_path


def problems(text: str) -> list[str]:
    Path("s.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        load_scenarios("s.yaml")
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize("name", BROKEN)
def test_broken_scenario_gives_a_line_with_its_place(folder: Path, name: str) -> None:
    text, place, words = BROKEN[name]
    found = problems(text)
    assert any(line.startswith(f"s.yaml:{place}") and words in line for line in found), found
    assert len(found) == 1 or name == "hardware", found
    assert "\n" not in found[0]


def test_all_problems_are_reported_in_the_order_of_the_file(folder: Path) -> None:
    found = problems(
        "arena:\n  vehicles:\n    uav1: {program: gone.py}\nmay: [crash uav2]\nsteps:\n  - do: kil router\n"
        "  - expect: uav1.landed\n  - 3\nalways: [separation > 1 m]\n"
    )
    assert [line.split(":")[1] for line in found] == ["3", "4", "6", "7", "8", "9"]


def test_problem_of_the_arena_file_has_its_place(folder: Path) -> None:
    Path("two.yaml").write_text("vehicles:\n  uav1: {prgram: fly.py}\n")
    assert problems(HEAD + "steps: [do: land all]\n") == [
        "two.yaml:2: vehicles.uav1.prgram: unknown key. Did you mean program?"
    ]


def test_problem_of_several_arenas_is_reported_once(folder: Path) -> None:
    assert len(problems("arena: [one.yaml, two.yaml]\nsteps:\n  - do: kil router\n")) == 1


def test_scenario_that_one_arena_cannot_fly_is_refused(folder: Path) -> None:
    found = problems("arena: [one.yaml, two.yaml]\nsteps:\n  - do: rc loss uav2\n")
    assert len(found) == 1 and found[0].startswith("s.yaml:3: steps[0].do: got 'uav2'")


def test_missing_file_is_an_input_error(folder: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.yaml: cannot be read"):
        load_scenarios("gone.yaml")


def test_list_of_arenas_is_one_scenario_each(folder: Path) -> None:
    Path("s.yaml").write_text("name: loss\narena: [one.yaml, two.yaml]\n" + STEP)
    one, two = load_scenarios("s.yaml", ["world.seed=7"])
    assert (one.name, two.name) == ("loss [one]", "loss [two]")
    assert (one.arena_file, two.arena_file) == ("one.yaml", "two.yaml")
    assert [v.name for v in two.arena.vehicles] == ["uav1", "uav2"]
    assert one.arena.world.seed == 7 and one.overrides == ("world.seed=7",)


def test_arena_path_is_relative_to_the_scenario(folder: Path) -> None:
    Path("deep").mkdir()
    Path("deep/s.yaml").write_text("arena: ../two.yaml\n" + STEP)
    (scenario,) = load_scenarios("deep/s.yaml")
    assert scenario.name == "s" and load_arena(scenario.arena_file).vehicles == scenario.arena.vehicles


def test_default_name_is_the_file_name(folder: Path) -> None:
    Path("rc_loss.smoke.yaml").write_text(HEAD + STEP)
    assert load_scenarios("rc_loss.smoke.yaml")[0].name == "rc_loss"


def test_later_override_wins(folder: Path) -> None:
    Path("s.yaml").write_text(HEAD + "set: [world.seed=3]\n" + STEP)
    assert load_scenarios("s.yaml")[0].arena.world.seed == 3
    assert load_scenarios("s.yaml", ["world.seed=4"])[0].arena.world.seed == 4


def test_arena_inside_a_scenario_has_its_folder(folder: Path) -> None:
    Path("s.yaml").write_text("arena: {vehicles: {uav1: {program: fly.py}}}\n" + STEP)
    (scenario,) = load_scenarios("s.yaml")
    assert scenario.arena_file == ""
    assert scenario.arena.vehicles[0].program is not None and scenario.arena.vehicles[0].program.path == str(
        folder / "fly.py"
    )


def test_entry_with_only_expect_belongs_to_the_step_before(folder: Path) -> None:
    Path("s.yaml").write_text(
        HEAD
        + STEP
        + "  - expect: uav1.landed within 2 s\n  - expect: [uav2.landed within 3 s, uav1.armed for 1 s]\n"
        "  - do: [land all, down]\n    expect: uav1.landed within 4 s\n"
    )
    (scenario,) = load_scenarios("s.yaml")
    first, second = scenario.steps
    assert [e.within_s for e in first.expect] == [2.0, 3.0, None]
    assert [e.place.line for e in first.expect] == [5, 6, 6]
    assert [d.verb for d in second.do] == ["land all", "down"] and len(second.expect) == 1
    assert first.place.text == "at uav1.airborne: kill program uav1" and first.place.line == 3


def test_fence_is_the_geofence_or_the_walls(folder: Path) -> None:
    Path("two.yaml").write_text("world: {size: [8, 6, 3]}\n" + TWO)
    Path("s.yaml").write_text(HEAD + STEP)
    assert load_scenarios("s.yaml")[0].fence == Box(low_n=(-4, -3, -3), high_n=(4, 3, math.inf))
    drawn = load_scenarios("s.yaml", ["geofence.margin_m=0.5"])[0].fence
    assert drawn == Box(low_n=(-3.5, -2.5, -2.5), high_n=(3.5, 2.5, math.inf))


def test_distance_to_the_fence_is_negative_inside() -> None:
    box = Box(low_n=(-4, -3, -3), high_n=(4, 3, math.inf))
    assert box.outside_m((0, 0, -1)) == pytest.approx(-2)
    assert box.outside_m((4.5, 0, -1)) == pytest.approx(0.5)
    assert box.outside_m((0, 0, -3.25)) == pytest.approx(0.25)


def test_scenario_has_the_sentence_about_what_it_tests(folder: Path) -> None:
    Path("two.yaml").write_text(TWO)
    Path("s.yaml").write_text("about: No failsafe may act.\n" + HEAD + STEP)
    assert load_scenarios("s.yaml")[0].about == "No failsafe may act."
    Path("s.yaml").write_text(HEAD + STEP)
    assert load_scenarios("s.yaml")[0].about == ""


def test_every_shipped_scenario_says_what_it_tests() -> None:
    examples = Path(__file__).parents[2] / "examples"
    for path in sorted(examples.rglob("*.smoke.yaml")):
        assert all(one.about.endswith(".") for one in load_scenarios(path)), path


def test_every_key_is_documented() -> None:
    assert set(descriptions(ScenarioFile)) == set(ScenarioFile.model_fields)


values = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-5, 5),
        st.sampled_from(["two.yaml", "kill all", "uav1.landed within 2 s", "", "é"]),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.sampled_from(["at", "do", "expect", "vehicles", "uav1"]), inner, max_size=3),
    ),
    max_leaves=6,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(st.dictionaries(st.sampled_from([*ScenarioFile.model_fields, "x"]), values, max_size=6))
def test_any_mapping_is_loaded_or_refused(folder: Path, data) -> None:
    import json

    Path("s.yaml").write_text(json.dumps(data))
    try:
        load_scenarios("s.yaml")
    except InputError as error:
        assert error.problems and all(p.file for p in error.problems)
