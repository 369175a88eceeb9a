"""The sweep file: strict, and every problem has its file and line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from arena.campaign import design, preparation, ray_cluster, runner
from arena.campaign import inputs as inputs_module
from arena.campaign.inputs import PACKAGE, PX4, changed, digest_of, digests
from arena.campaign.measures import MEASURES
from arena.campaign.sweep import Setting, SweepFile, load_sweep
from arena.cli import main
from arena.errors import InputError
from arena.schema import load_arena
from arena.schema.library import data_folder
from arena.schema.px4 import STAND_IN
from arena.smoke.flying.fly_scenario import refuse_real

Write = Callable[[str], Path]


def problems(path: Path) -> list[tuple[int, str]]:
    with pytest.raises(InputError) as error:
        load_sweep(path)
    return [(p.line, f"{p.field}: {p.message}") for p in error.value.problems]


def test_complete_sweep_is_loaded(sweep_file: Write) -> None:
    found = load_sweep(
        sweep_file(
            "name: wind\narena: arena.yaml\nset: [mocap.rate_hz=120]\nseeds: 3\nsamples: 4\n"
            "vary:\n  mocap.latency_ms: [5, 20]\n  defaults.mass_kg: {min: 1.0, max: 1.4}\n"
        )
    )
    assert (found.name, found.kind, found.seeds, found.samples) == ("wind", "arena", (1, 2, 3), 4)
    assert found.drawn == ("defaults.mass_kg",) and Path(found.flown).name == "arena.yaml"


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("arena: arena.yaml\nseed: 3\n", 2, "seed: unknown key. Did you mean seeds?"),
        ("seeds: 2\n", 1, "got neither, expected `arena` or `scenario`"),
        ("arena: a.yaml\nscenario: b.yaml\n", 2, "scenario: got both"),
        ("arena: a.yaml\nseeds: 0\n", 2, "seeds: got 0, expected the number of seeds"),
        ("arena: a.yaml\nseeds: [1, true]\n", 2, "seeds: got [1, true]"),
        ("arena: a.yaml\nvary:\n  mass: 3\n", 3, "vary.mass: got 3, expected a list of values"),
        ("arena: a.yaml\nvary:\n  mass: []\n", 3, "at least 1 entry"),
        ("arena: a.yaml\nvary:\n  mass: {min: 1}\n", 3, "vary.mass: expected `values`, or `min` and `max`"),
        ("arena: a.yaml\nvary:\n  mass: {min: 1, max: 2}\n", 3, "samples: is missing"),
        ("arena: a.yaml\nsamples: 3\n", 2, "samples: no range to draw from"),
        (
            "arena: a.yaml\nvary:\n  m: {min: 2, max: 1, steps: 3}\n",
            3,
            "vary.m.max: got 1, expected more than",
        ),
        ("arena: a.yaml\nvary:\n  m: {min: 0, max: 1, steps: 3, scale: log}\n", 3, "expected more than 0"),
        ("arena: a.yaml\nvary:\n  m: {min: 1, max: 3, steps: 9, integer: true}\n", 3, "only 3 integers"),
        ("arena: a.yaml\nvary:\n  m: {values: [1], max: 2}\n", 3, "got `values` and a range"),
        ("arena: a.yaml\nvary:\n  m: {values: [1], scale: log}\n", 3, "vary.m.scale: is only for a range"),
        ("arena: a.yaml\nvary:\n  m: [1, 1]\n", 3, "contains a value twice"),
        ("arena: a.yaml\nvary:\n  m: {values: [1], set: x.y=3}\n", 3, "expected key=value with {} for"),
        ("arena: a.yaml\nvary:\n  seed: [1]\n", 3, "vary.seed: is a column of the results"),
        ("arena: a.yaml\nvary:\n  crashes: [1]\n", 3, "vary.crashes: is a column of the results"),
        ("arena: a.yaml\nvary:\n  m: {min: 0.5, max: 3.5, steps: 4, integer: true}\n", 3, "only 3 integers"),
        (
            "arena: a.yaml\nsamples: 2\nvary:\n  m: {min: 0.2, max: 0.8, integer: true}\n",
            4,
            "only 0 integers",
        ),
        ("arena: a.yaml\nsampling: sobol\n", 2, "expected latin_hypercube or random"),
    ],
)
def test_problem_has_its_line(sweep_file: Write, text: str, line: int, said: str) -> None:
    found = problems(sweep_file(text))
    assert [at for at, _ in found] == [line] and said in found[0][1], found


def test_all_problems_are_reported_at_once(sweep_file: Write) -> None:
    assert [at for at, _ in problems(sweep_file("arena: a.yaml\nseeds: x\nvary:\n  m: {min: 1}\n"))] == [2, 4]


@pytest.mark.parametrize(
    ("vary", "line", "said"),
    [
        ("  world.wind: [1]\n", 3, "world.wind: unknown key"),
        ("  mocap.rate_hz:\n    - 100\n    - -4\n", 5, "mocap.rate_hz: got -4, expected"),
        (
            "  world.seed: [7, 8]\n",
            3,
            "world.seed cannot be set: the campaign sets it in each flight. Use `seeds`",
        ),
        ("  w: {values: [1, 2], set: 'world={seed: {}}'}\n", 3, "world.seed cannot be set"),
        ("  sim.speed: [1, 2]\n", 3, "sim.speed cannot be set: a campaign always flies as fast as possible"),
        ("  vehicles.uva1.mass_kg: [1.0, 1.2]\n", 3, "the arena has no vehicle 'uva1'. It has: uav1"),
        (
            "  defaults.params.MPC_XY_PP: [1.0, 1.2]\n",
            3,
            "has no effect: all its values give the same flight",
        ),
        ("  vehicles.uav1.params.COM_ARM_SDCARD: [0, 1]\n", 3, "has no effect"),
        ("  wind: {values: [1, x], set: 'world.wind_m_s=[{}, 0, 0]'}\n", 3, "world.wind_m_s"),
        ("  defaults.mass_kg: [-1.0]\n", 3, "got -1.0, expected more than 0"),
    ],
)
def test_wrong_value_of_a_setting_has_its_line(sweep_file: Write, vary: str, line: int, said: str) -> None:
    path = sweep_file(f"arena: arena.yaml\nvary:\n{vary}")
    sweep = load_sweep(path)
    with pytest.raises(InputError) as error:
        preparation.check(sweep, design.flights(sweep))
    (first, *_) = error.value.problems
    assert (first.file, first.line) == (str(path), line) and said in first.message, error.value


def test_missing_arena_and_real_vehicles_are_refused(sweep_file: Write, tmp_path: Path) -> None:
    missing = load_sweep(sweep_file("seeds: 2\narena: other.yaml\n"))
    with pytest.raises(InputError, match=r"sweep.yaml:2: arena: got 'other.yaml', which does not exist"):
        preparation.check(missing, design.flights(missing))
    real = load_sweep(sweep_file("arena: arena.yaml\nset: [vehicles.uav1.autopilot=hardware]\n"))
    (tmp_path / "arena.yaml").write_text(
        "vehicles:\n  uav1: {program: fly.py, autopilot: builtin, url: 'udpin:0.0.0.0:15000'}\n"
    )
    with pytest.raises(InputError):
        preparation.check(real, design.flights(real))


def test_arena_without_a_program_is_refused(sweep_file: Write, tmp_path: Path) -> None:
    sweep = load_sweep(sweep_file("arena: arena.yaml\n"))
    (tmp_path / "arena.yaml").write_text("vehicles: {uav1: {autopilot: builtin}}\n")
    with pytest.raises(InputError, match="no vehicle has a program"):
        preparation.check(sweep, design.flights(sweep))


def test_each_point_is_checked_once_for_all_seeds(sweep_file: Write) -> None:
    sweep = load_sweep(sweep_file("arena: arena.yaml\nseeds: 50\nvary: {defaults.mass_kg: [1.0, 1.2]}\n"))
    checked: list[int] = []
    preparation.check(sweep, design.flights(sweep), lambda: checked.append(1))
    assert len(checked) == 2


def test_page_names_every_key_and_measure() -> None:
    page = (Path(__file__).parents[2] / "docs" / "howto" / "run-a-campaign.md").read_text()
    named = {*SweepFile.model_fields, *Setting.model_fields, *(m.name for m in MEASURES)}
    assert not {name for name in named if f"`{name}`" not in page}


def test_shipped_sweep_is_valid() -> None:
    sweep = load_sweep(Path(__file__).parents[2] / "examples" / "12_campaign" / "sweep.yaml")
    found = design.flights(sweep)
    assert len(found) == 24 and preparation.check(sweep, found).arena.vehicles


def test_setting_below_a_value_of_the_vehicle_is_refused(sweep_file: Write, tmp_path: Path) -> None:
    path = sweep_file("arena: arena.yaml\nvary: {defaults.mass_kg: [1.0, 1.2]}\n")
    (tmp_path / "arena.yaml").write_text(
        "vehicles: {uav1: {autopilot: builtin, program: fly.py, mass_kg: 1.5}}\n"
    )
    sweep = load_sweep(path)
    with pytest.raises(InputError, match=r"sweep.yaml:2: vary.defaults.mass_kg: has no effect"):
        preparation.check(sweep, design.flights(sweep))


def test_parameter_that_only_px4_uses_may_be_varied_with_the_autopilot(
    sweep_file: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PX4_HOME", STAND_IN)
    text = "arena: arena.yaml\nvary: {vehicles.uav1.autopilot: [builtin, px4], vehicles.uav1.params.COM_ARM_SDCARD: [0, 1]}\n"
    sweep = load_sweep(sweep_file(text))
    assert PX4 in preparation.check(sweep, design.flights(sweep)).inputs


def test_vehicle_that_an_override_adds_may_be_varied(sweep_file: Write) -> None:
    text = "arena: arena.yaml\nset: ['vehicles.uav2={start: {position: [2, 0, 0]}}']\nvary: {vehicles.uav2.mass_kg: [1.0, 1.2]}\n"
    sweep = load_sweep(sweep_file(text))
    assert len(preparation.check(sweep, design.flights(sweep)).arena.vehicles) == 2


def test_flight_controller_in_the_loop_is_refused(tmp_path: Path) -> None:
    (tmp_path / "arena.yaml").write_text("vehicles: {uav1: {autopilot: hitl, serial: /dev/ttyACM0}}\n")
    with pytest.raises(InputError, match=r"vehicles with real flight controllers \(uav1\)"):
        refuse_real(load_arena(tmp_path / "arena.yaml"))


INPUTS = """\
defaults: {autopilot: builtin}
vehicles:
  uav1: {program: fly.py, params_file: uav1.params, profile: own.yaml}
"""


def test_inputs_are_the_files_that_determine_a_flight(sweep_file: Write, tmp_path: Path) -> None:
    path = sweep_file("arena: arena.yaml\nvary: {vehicles.uav1.program: [fly.py, b.py]}\n")
    (tmp_path / "arena.yaml").write_text(INPUTS)
    (tmp_path / "b.py").write_text("pass\n")
    (tmp_path / "own.yaml").write_text((data_folder("profiles") / "iris.yaml").read_text())
    (tmp_path / "uav1.params").write_text("1\t1\tMPC_XY_P\t0.9\t9\n")

    def inputs() -> Mapping[str, str]:
        sweep = load_sweep(path)
        return preparation.check(sweep, design.flights(sweep)).inputs

    before = inputs()
    files = {"arena.yaml", "fly.py", "b.py", "own.yaml", "uav1.params"}
    assert set(before) == {*files, PACKAGE}
    path.write_text("arena: arena.yaml\nvary: {vehicles.uav1.program: [b.py, fly.py]}\n")
    assert changed(before, inputs()) == []
    path.write_text("arena: arena.yaml\nvary: {vehicles.uav1.program: [fly.py]}\n")
    assert changed(before, inputs()) == changed(inputs(), before) == [], "values were added or removed"
    for name in sorted(files - {"b.py"}):
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text + ("\n" if name != "arena.yaml" else "# changed\n"))
        assert changed(before, inputs()) == [name]
        (tmp_path / name).write_text(text)
    assert changed(before, {**inputs(), PACKAGE: "another"}) == [PACKAGE]
    assert changed({k: v for k, v in before.items() if k != PACKAGE}, inputs()) == [PACKAGE]


def test_package_digest_includes_the_profiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = digest_of(PACKAGE)
    monkeypatch.setattr(inputs_module, "data_folder", lambda name: tmp_path)
    inputs_module._package_digest.cache_clear()
    try:
        assert digest_of(PACKAGE) != before
    finally:
        inputs_module._package_digest.cache_clear()


def test_real_px4_is_one_of_the_inputs(tmp_path: Path) -> None:
    (tmp_path / "px4").write_bytes(b"1")
    before = digests((), tmp_path, {str(tmp_path / "px4")})
    (tmp_path / "px4").write_bytes(b"2")
    assert changed(before, digests((), tmp_path, {str(tmp_path / "px4")})) == [PX4]
    assert changed(before, digests((), tmp_path, {STAND_IN})) == [PX4]
    assert changed(before, digests((), tmp_path)) == [], "no vehicle flies PX4 any more"


def test_sweep_names_the_cluster_and_jobs_overrides_it(
    sweep_file: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = sweep_file("name: c\narena: arena.yaml\ncluster: lab:6379\n")
    used: list[str] = []
    monkeypatch.setattr(ray_cluster, "fly_all", lambda *_, address, **more: used.append(address))
    monkeypatch.setattr(runner, "fly_all", lambda *_, **more: used.append("here"))
    monkeypatch.chdir(tmp_path)
    main(["campaign", str(sweep)])
    main(["campaign", str(sweep), "--cluster", "auto"])
    main(["campaign", str(sweep), "-j", "1"])
    assert used == ["lab:6379", "auto", "here"]
