"""The page, summary.txt, summary.json and the table of `arena up` say the same about the end of a flight."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_flights import make_run

from arena.cli._summary import lines_of
from arena.report.fates import Fate, fate_of
from arena.report.happenings import happenings
from arena.report.run_data import RunData, read_run
from arena.report.run_report import disarmed_vehicles, summarise
from arena.report.summary import as_text

COLUMNS = {"armed": "info.is_armed", "landed": "info.is_landed", "down": "truth.pos.down"}
Change = tuple[slice, float]


@pytest.fixture
def run(tmp_path: Path) -> RunData:
    """Return a run of one vehicle that flies in OFFBOARD, lands in AUTO.LAND, and is disarmed at row 240."""
    return read_run(make_run(tmp_path / "run"))


def changed(run: RunData, **columns: list[Change]) -> RunData:
    """Return the run with other values in some rows. columns: armed, landed or down -> (rows, value); NaN is unknown."""
    flight = run.flights["uav1"]
    numbers = {name: values.copy() for name, values in flight.numbers.items()}
    for column, changes in columns.items():
        for rows, value in changes:
            numbers[COLUMNS[column]][rows] = value
    flags = {column: numbers[COLUMNS[column]] == 1.0 for column in ("armed", "landed")}
    return replace(run, flights={"uav1": replace(flight, numbers=numbers, **flags)})


@dataclass(frozen=True, kw_only=True)
class Said:
    """What the reports say about uav1: fate on the page, row of summary.txt, entry of summary.json, line of `arena up`."""

    fate: Fate
    text: str
    values: dict[str, Any]
    line: str


def said(run: RunData) -> Said:
    made = summarise(
        names=run.names,
        flights=run.flights,
        outcome=run.outcome,
        missing=run.missing,
        disarmed=disarmed_vehicles(run),
        origin_s=run.origin_s,
    )
    (text,) = [row for row in as_text(made).splitlines() if row.startswith("uav1")]
    (run.folder / "summary.json").write_text(json.dumps(made))
    return Said(
        fate=fate_of("uav1", run, happenings(run)),
        text=text,
        values=made["vehicles"]["uav1"],
        line=lines_of(run.folder)[0],
    )


def test_vehicle_that_armed_and_did_not_take_off_did_not_fly(run):
    found = said(changed(run, down=[(slice(None), -0.05)]))
    assert found.fate.end == "did not fly" and "uav1 did not fly" in found.line
    assert found.text.endswith(" not flown") and found.values["flown"] is False
    landing = found.values["landing"]
    assert landing["landed"] is False and landing["error_m"] is None and landing["touchdown_s"] is None


def test_vehicle_that_falls_silent_after_its_landing_has_landed(run):
    silent = slice(260, None)
    found = said(changed(run, armed=[(silent, np.nan)], landed=[(silent, np.nan)]))
    assert found.fate.end == "landed" and "uav1 landed" in found.line
    assert found.text.endswith("  landed") and found.values["landing"]["landed"] is True
    assert found.values["landing"]["error_m"] == said(run).values["landing"]["error_m"] is not None


def test_vehicle_that_falls_silent_armed_on_the_floor_is_not_confirmed(run):
    silent = slice(220, None)
    found = said(changed(run, armed=[(silent, np.nan)], landed=[(silent, np.nan)]))
    assert found.fate.end == "landed but stayed armed" and "uav1 landing not confirmed" in found.line
    assert found.text.endswith("NOT landed")


def test_log_that_ends_in_the_air_has_no_landing(run):
    rest = slice(100, None)
    found = said(changed(run, armed=[(rest, np.nan)], landed=[(rest, np.nan)]))
    assert (found.fate.end, found.fate.level) == ("was still in the air when its log ended", "bad")
    assert found.text.endswith("NOT landed") and found.values["landing"]["error_m"] is None


def test_fall_of_an_earlier_flight_is_in_page_and_summary(run):
    first = changed(
        run,
        armed=[(slice(80, 120), 0.0)],
        landed=[(slice(85, 120), 1.0)],
        down=[(slice(85, 121), -0.05)],
    )
    found = said(first)
    assert found.fate.end == "was disarmed in the air and fell 0.9 m" and found.text.endswith("NOT landed")


@pytest.mark.parametrize(
    ("height_m", "end", "level", "summary"),
    [
        (1.0, "was disarmed in the air and fell 0.9 m", "bad", "NOT landed"),
        (0.2, "landed", "good", "  landed"),
    ],
)
def test_log_goes_on_after_a_disarming_in_the_air(run, height_m, end, level, summary):
    found = said(
        changed(
            run,
            armed=[(slice(100, None), 0.0)],
            landed=[(slice(0, 110), 0.0), (slice(110, None), 1.0)],
            down=[(slice(0, 20), -0.05), (slice(20, 104), -height_m), (slice(104, None), -0.05)],
        )
    )
    assert (found.fate.end, found.fate.level) == (end, level) and found.text.endswith(summary)


def test_disarming_whose_landing_is_never_reported_is_named(run):
    found = said(
        changed(
            run,
            armed=[(slice(100, None), 0.0)],
            landed=[(slice(None), 0.0)],
            down=[(slice(0, 20), -0.05), (slice(20, 100), -0.2), (slice(100, None), -0.05)],
        )
    )
    assert (found.fate.end, found.fate.level) == ("was disarmed before its landing was reported", "warn")
    assert found.text.endswith("NOT landed")
