"""Tests of the table of the thesis's experiments: figures of a log, and the files expect.yaml."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"
COLUMNS = (
    "time.seconds,ekf.pos.north,ekf.pos.east,ekf.pos.down,ekf.att_euler.roll,ekf.att_euler.pitch,ekf.att_euler.yaw,"
    "info.flight_mode,info.is_armed,info.is_landed,pos_ref.north,pos_ref.east,pos_ref.down"
)


@pytest.fixture(scope="module")
def thesis() -> ModuleType:
    return load("expectations")


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"thesis_{name}", FOLDER / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder with one log: 1 s on the ground, then OFFBOARD with an error of (0.3, 0, -0.4) m from 2 s on."""
    rows = [COLUMNS]
    for k in range(60):
        since = k / 10 - 1.0
        far = since >= 2.0
        rows.append(
            f"{100 + k / 10},{1.3 if far else 1.0},2,{-1.4 if far else -1.0},{0.2 if far else 0.0},0,0,"
            f"{'OFFBOARD' if since >= 0 else 'AUTO.LOITER'},True,False,1,2,-1"
        )
    (tmp_path / "csv").mkdir()
    (tmp_path / "logs").mkdir()
    (tmp_path / "csv" / "uav1.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "logs" / "program.uav1.log").write_text("started\nrange_error_m: 0.5\nrange_error_m: 0.25\n")
    return tmp_path


def figure(thesis: ModuleType, run: Path, name: str, **limits: float) -> float:
    row = thesis.Row(vehicle="uav1", figure=name, at_most=1.0, **limits)
    (found,) = thesis.measure(thesis.Expected(name="x", arena=run, rows=(row,)), run)
    return float(found.ours)


def test_tracking_is_the_rms_distance_in_the_window_since_offboard(thesis: ModuleType, run: Path) -> None:
    assert figure(thesis, run, "tracking", from_s=0.0, to_s=1.85) == pytest.approx(0.0)
    assert figure(thesis, run, "tracking", from_s=2.05) == pytest.approx(0.5)
    assert figure(thesis, run, "tracking.down", from_s=2.05) == pytest.approx(0.4)
    assert figure(thesis, run, "end_error") == pytest.approx(0.5)


def test_tilt_is_in_degrees(thesis: ModuleType, run: Path) -> None:
    assert figure(thesis, run, "tilt") == pytest.approx(math.degrees(0.2))


def test_printed_figure_is_the_last_one(thesis: ModuleType, run: Path) -> None:
    assert figure(thesis, run, "said range_error_m") == 0.25


@pytest.mark.parametrize("name", ["said other", "tracking"])
def test_missing_figure_fails_its_row(thesis: ModuleType, run: Path, name: str) -> None:
    row = thesis.Row(vehicle="uav9", figure=name, at_most=1.0)
    (found,) = thesis.measure(thesis.Expected(name="x", arena=run, rows=(row,)), run)
    assert math.isnan(found.ours) and not found.passed
    assert "FAILED" in thesis.table([found])


def test_row_without_limit_is_refused(thesis: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "expect.yaml").write_text(
        "title: T\ntests: 1\nflights: {a: {arena: arena.yaml, rows: [{vehicle: uav1, figure: tilt}]}}\n"
    )
    with pytest.raises(ValueError, match="no limit"):
        thesis.read_expected(tmp_path)


@pytest.mark.parametrize(
    "folder", sorted(p.parent for p in FOLDER.glob("*/expect.yaml")), ids=lambda p: p.name
)
def test_every_expectation_names_vehicles_of_its_arena(thesis: ModuleType, folder: Path) -> None:
    from arena.schema import load_arena

    _, _, flights = thesis.read_expected(folder)
    assert flights
    for flight in flights:
        arena = load_arena(flight.arena, flight.overrides)
        names = {name for v in arena.vehicles for name in (v.name, v.program and v.program.group)}
        assert {row.vehicle for row in flight.rows} <= names


def test_refusal_of_a_backend_is_found_in_the_output(
    monkeypatch: pytest.MonkeyPatch, thesis: ModuleType
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    fly = load("fly")
    variant = fly.Variant(autopilot="builtin", backend="mavsdk")
    output = "started\ngroup.show: ended (arena.errors.InputError: backend mavsdk: at most 16 (MAVSDK) here)\nend\n"
    assert fly.refusal(output, variant) == "backend mavsdk: at most 16 (MAVSDK) here"
    assert fly.refusal("NotConfirmedError: backend mavsdk: no heartbeat\n", variant) is None


@pytest.mark.parametrize("backend", ["mavlink", "mavsdk"])
def test_variant_sets_the_library_of_all_vehicles(
    monkeypatch: pytest.MonkeyPatch, thesis: ModuleType, backend: str
) -> None:
    from arena.schema import load_arena

    monkeypatch.setattr(sys, "path", [*sys.path])
    variant = load("fly").Variant(autopilot="builtin", backend=backend)
    for folder in sorted(path.parent for path in FOLDER.glob("*/expect.yaml")):
        for flight in thesis.read_expected(folder)[2]:
            arena = load_arena(flight.arena, (*flight.overrides, *variant.overrides))
            assert {(v.autopilot, v.backend) for v in arena.vehicles} == {("builtin", backend)}


THESIS = Path(__file__).parents[3] / "shared" / "data" / "thesis"


@pytest.mark.skipif(not THESIS.is_dir(), reason="the logs of the thesis are not part of this project")
def test_figures_of_the_thesis_come_from_its_logs_by_the_same_function(thesis: ModuleType) -> None:
    _, _, flights = thesis.read_expected(FOLDER / "formation")
    flown = next(
        flight for flight in flights if flight.name == "start_offsets"
    )  # the thesis did not fly the other one
    for row in flown.rows:
        (log,) = thesis.read_flights(THESIS / f"formation_gazebo_{row.vehicle}.csv")
        window = (log.t >= row.from_s) & (log.t <= row.to_s)
        assert thesis.FIGURES[row.figure](log, window) == pytest.approx(row.thesis, abs=5e-4)


def test_flight_that_exceeds_its_time_limit_has_failed_and_is_stopped() -> None:
    fly = load("fly")
    code, output = fly.run_within([sys.executable, "-c", "import time; time.sleep(600)"], 0.2)
    assert code != 0
    assert output.endswith("not finished after 0.2 s of wall time\n")
