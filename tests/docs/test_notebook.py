"""Tests of the notebook that analyses a run: its cells run and agree with the report, and its page shows its stored outputs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from recorded_flights import flight_csv, make_run

from arena.flight_log.open import read_flights
from arena.report.analysis import analyse

from .pages import ROOT, notebook_page

pd = pytest.importorskip("pandas")

NOTEBOOK = ROOT / "docs/howto/analyse-a-run.ipynb"
CELLS = [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]
APART_M = 2.0


@pytest.fixture(params=["simulated", "real"])
def run(request, tmp_path, monkeypatch) -> Path:
    """Make a run of two vehicles in the folder that the notebook reads. The second vehicle is 2 m north of the first."""
    run = make_run(tmp_path / "examples/01_two_quads/runs/20261122-120000-01_two_quads", vehicles=2)
    logs = run / "csv"
    (logs / "uav1.csv").write_text(flight_csv(real=request.param == "real"))
    log = pd.read_csv(logs / "uav1.csv")
    for group in ("truth", "mocap", "ekf"):
        if f"{group}.pos.north" in log:
            log[f"{group}.pos.north"] += APART_M
    log["pos_ref.north"] += APART_M
    log.to_csv(logs / "uav2.csv", index=False)
    (tmp_path / "docs/howto").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "docs/howto")
    monkeypatch.setenv("MPLBACKEND", "agg")
    return run


def values_of_cells() -> dict[str, Any]:
    """Run the cells in order, and return the names that they define."""
    from matplotlib import pyplot

    pyplot.switch_backend("agg")
    values: dict[str, Any] = {}
    for number, cell in enumerate(CELLS, 1):
        exec(compile("".join(cell["source"]), f"cell {number}", "exec"), values)
    pyplot.close("all")
    return values


def test_cells_agree_with_the_report(run):
    values = values_of_cells()
    for flight in read_flights(run):
        name, expected = flight.name, analyse(flight)
        assert values["tracking"][name]["rms [m]"] == pytest.approx(expected["tracking"]["rms_m"], abs=1e-4)
        found = values["setpoints"].query("vehicle == @name")["at the end [m]"].tolist()
        ends = [each["error_m"] for each in expected["setpoints"]["each"]]
        assert len(ends) == 2 and found == pytest.approx(ends, abs=1e-4)
        error = values["estimate"][name]
        assert error["position rms [mm]"] == pytest.approx(1e3 * expected["estimator"]["pos_rms_m"], abs=0.1)
        assert error["yaw rms [deg]"] == pytest.approx(expected["estimator"]["yaw_rms_deg"], abs=1e-3)
        assert values["battery"][name]["last [%]"] == expected["battery_end"]


def test_cells_measure_time_in_the_air_gaps_and_distance(run):
    values = values_of_cells()
    for name in ("uav1", "uav2"):
        air = values["air"][name]
        assert air["in the air [s]"] == pytest.approx(6.0, abs=0.1)  # 180 rows of 30 Hz
        assert air["max height [m]"] == pytest.approx(1.0)
        assert values["gaps"][name, "ekf.pos"]["longest pause [s]"] == pytest.approx(1 / 30, abs=1e-3)
    assert values["distance"].to_numpy() == pytest.approx(APART_M)
    assert values["difference"].to_numpy() == pytest.approx(0.0)


@pytest.mark.parametrize("run", ["simulated"], indirect=True)
def test_lost_motion_capture_is_a_gap_in_the_table(run):
    log = pd.read_csv(run / "csv/uav1.csv")
    log.loc[60:89, [f"mocap.pos.{part}" for part in ("north", "east", "down")]] = float("nan")
    log.to_csv(run / "csv/uav1.csv", index=False)
    gaps = values_of_cells()["gaps"]
    assert gaps["uav1", "mocap.pos"]["longest pause [s]"] == pytest.approx(31 / 30, abs=1e-3)
    assert gaps["uav1", "mocap.pos"]["filled [%]"] < 100 == gaps["uav2", "mocap.pos"]["filled [%]"]


def test_stored_outputs_are_complete_and_small():
    assert [cell["execution_count"] for cell in CELLS] == list(range(1, len(CELLS) + 1))
    outputs = [output for cell in CELLS for output in cell["outputs"]]
    assert {output["output_type"] for output in outputs} <= {"execute_result", "display_data"}
    assert NOTEBOOK.stat().st_size < 300_000


def test_page_shows_every_cell_and_picture():
    text, pictures = notebook_page(NOTEBOOK)
    assert all("".join(cell["source"]) in text for cell in CELLS)
    assert len(pictures) >= 4 and all(f"]({name})" in text for name in pictures)
    assert all(picture.startswith(b"\x89PNG") for picture in pictures.values())
    assert "<table>" in text and "<style" not in text


def test_notebook_with_an_exception_is_refused(tmp_path):
    error = {"output_type": "error", "ename": "KeyError", "evalue": "'x'", "traceback": []}
    cell = {"cell_type": "code", "source": ["x"], "outputs": [error]}
    (tmp_path / "failed.ipynb").write_text(json.dumps({"cells": [cell]}))
    with pytest.raises(ValueError, match=r"failed\.ipynb.*error"):
        notebook_page(tmp_path / "failed.ipynb")
