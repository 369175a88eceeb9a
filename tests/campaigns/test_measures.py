"""Measures, table and texts of a campaign."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from rich.console import Console

from arena.campaign import progress, report, table
from arena.campaign.fly import measured
from arena.campaign.measures import of_flight, of_vehicle, recorded_by_world
from arena.campaign.store import Listing, Record

from .conftest import record


def listing(records: list[Record]) -> Listing:
    rows = [{"id": r.id, "number": r.number, "seed": r.seed, "settings": r.settings} for r in records]
    return Listing(name="wind", sweep="s.yaml", kind="arena", inputs={}, flights=rows)


def test_flight_has_the_worst_value_of_its_vehicles_and_the_sum_of_crashes() -> None:
    found = of_flight(
        {
            "uav1": {"tracking_rms_m": 0.1, "crashes": 1.0, "landing_error_m": None},
            "uav2": {"tracking_rms_m": 0.3, "crashes": 1.0},
        }
    )
    assert (found["tracking_rms_m"], found["crashes"], found["landing_error_m"]) == (0.3, 2.0, None)


def test_vehicle_without_log_has_what_the_world_recorded() -> None:
    judged = {"crashed": "hit the wall", "airborne_s": 3.0, "touchdown_m_s": None, "max_tilt_deg": 80.0}
    found = of_vehicle(None, judged)
    assert (found["crashes"], found["airborne_s"], found["tracking_rms_m"]) == (1.0, 3.0, None)
    assert of_vehicle(None, {})["crashes"] is None


def test_outcome_without_a_world_has_no_vehicles() -> None:
    assert recorded_by_world({}) == {} == recorded_by_world({"processes": {"world": {"stats": None}}})


def test_run_folder_without_files_has_no_measures(tmp_path: Path) -> None:
    assert measured(tmp_path) == {}


def test_setting_with_mixed_values_becomes_text() -> None:
    records = [
        record("a", settings={"w": [0, 1], "n": 1, "b": "x"}),
        record("b", settings={"w": [2, 3], "n": 2.5, "b": None}),
    ]
    found = table.columns(listing(records), records)
    assert found["w"] == ["[0, 1]", "[2, 3]"] and found["n"] == [1.0, 2.5] and found["b"] == ["x", "null"]


def test_report_has_medians_of_each_point_and_failures() -> None:
    records = [
        record(
            str(i),
            i + 1,
            seed=i % 3,
            passed=i != 4,
            settings={"wind": float(i // 3)},
            run=f"flights/{i}",
            measures={"tracking_rms_m": float(i), "crashes": 0.0},
        )
        for i in range(6)
    ]
    console = Console(file=io.StringIO(), width=160)
    console.print(report.text(listing(records), records))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "wind: 6 flights: 5 passed, 1 failed" in text
    rows = [line.split() for line in text.splitlines()]
    assert ["0", "3", "0", "1", "0"] in rows and ["1", "3", "1", "4", "0"] in rows
    assert "FAILED  flight 5 wind=1 seed=1  flights/4" in text and "it fell" in text


def test_only_flights_of_the_present_sweep_are_shown() -> None:
    records = [record("a", 1), record("b", 2), record("old", 9)]
    found = report.in_campaign(listing([record("b", 1), record("c", 2)]), records)
    assert [(r.id, r.number) for r in found] == [("b", 1)]


def test_plots_show_text_settings_and_missing_values(tmp_path: Path) -> None:
    records = [
        record("a", settings={"px": "x$1"}, measures={"tilt_max_deg": 3.0}),
        record("b", settings={"px": "y"}, passed=False, measures={"tilt_max_deg": None}),
    ]
    (path,) = table.write_plots(listing(records), records, tmp_path)
    assert path.name == "tilt_max_deg.png" and path.stat().st_size > 5000
    assert np.isnan(table._number(None))


def test_time_left_counts_only_flights_of_this_start() -> None:
    now = [100.0]
    pace = progress.Pace(clock=lambda: now[0])
    pace.begin(total=10, flown=4)
    assert pace.left_s is None and pace.left == ""
    now[0] = 130.0
    pace.add()
    pace.add()
    assert pace.left_s == 60.0 and pace.left == "60 s left"


def test_durations_are_short_texts() -> None:
    assert [progress.duration(s) for s in (8.4, 720, 7500)] == ["8 s", "12 min", "2 h 05 min"]


def test_bar_prints_failed_flights_and_the_time_left() -> None:
    now = [0.0]
    console = Console(file=io.StringIO(), width=120, force_terminal=True)
    with progress.ProgressBar(progress.Pace(clock=lambda: now[0]), console) as bar:
        bar.begin(4, 1, 0)
        now[0] = 600.0
        bar.add(record("a", passed=False))
        bar.refresh()
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "2/4" in text and "20 min left" in text and "1 failed" in text and "it fell" in text
