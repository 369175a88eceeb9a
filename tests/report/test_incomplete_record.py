"""Reports of runs whose flight.mcap lacks a part of the flight."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record_files import UAV1, RecordFile, damage_second_chunk
from recorded_flights import make_run

from arena.cli._summary import lines_of
from arena.report.fates import fate_of
from arena.report.happenings import happenings
from arena.report.run_data import RunData, read_run
from arena.report.run_report import summarise, write_summary
from arena.report.summary import as_text
from arena.report.verdict import verdict

FULL = {"record": "No space left on device"}
STOPPED = "flight.mcap is incomplete: the recorder stopped during the run: No space left on device"


def run_with(folder: Path, recorder: dict[str, Any], airborne_s: float = 7.0) -> Path:
    """Write a run of one vehicle with these statistics of its recorder, and return its folder."""
    run = make_run(folder)
    outcome = json.loads((run / "outcome.json").read_text())
    outcome["processes"]["recorder"]["stats"] |= recorder
    outcome["processes"]["world"]["stats"]["vehicles"]["uav1"]["airborne_s"] = airborne_s
    (run / "outcome.json").write_text(json.dumps(outcome))
    return run


@pytest.mark.parametrize(
    ("recorder", "expected"),
    [
        (FULL, STOPPED),
        (
            {"record": "complete", "lost_datagrams": 50},
            "flight.mcap is incomplete: the recorder was late and lost 50 datagrams",
        ),
    ],
)
def test_loss_that_the_recorder_reports_is_named(tmp_path, recorder, expected):
    folder = run_with(tmp_path / "run", recorder)
    run, text = write_summary(folder)
    judged = verdict(run, happenings(run))
    assert judged.level == "warn" and expected in judged.causes
    assert f"missing: {expected}" in text


def test_complete_record_is_no_cause(tmp_path):
    run = read_run(run_with(tmp_path / "run", {"record": "complete", "lost_datagrams": 0}))
    judged = verdict(run, happenings(run))
    assert judged.level == "good" and not run.missing and not judged.causes


@pytest.mark.parametrize("killed", [False, True])
def test_damaged_part_of_the_record_is_named(tmp_path, killed):
    folder = make_run(tmp_path / "run")
    path = folder / "flight.mcap"
    made = RecordFile(path, [UAV1])
    for k in range(4000):
        made.channels.on_datagrams([("uav1", False, b"datagram %d" % k, 0.001 * k)])
        if k % 500 == 499:
            made.end_chunk()
    made.close()
    damage_second_chunk(path, lost_bytes=100 if killed else 0)
    run, text = write_summary(folder)
    expected = "flight.mcap is incomplete: 1 damaged part was skipped"
    assert run.missing.count(expected) == 1 and f"missing: {expected}" in text
    assert expected in verdict(run, happenings(run)).causes


def without_flight(run: RunData) -> RunData:
    """Return the run with a log that ends before the vehicle is armed."""
    flight, n = run.flights["uav1"], 20
    numbers = {name: values[:n].copy() for name, values in flight.numbers.items()}
    numbers["info.is_armed"][:], numbers["info.is_landed"][:], numbers["truth.pos.down"][:] = 0.0, 1.0, -0.05
    off, on = np.zeros(n, bool), np.ones(n, bool)
    cut = replace(flight, t=flight.t[:n], numbers=numbers, mode=["AUTO.LOITER"] * n, armed=off, landed=on)
    return replace(run, flights={"uav1": cut})


@pytest.mark.parametrize(
    ("recorder", "airborne_s", "end", "clause", "summary", "line"),
    [
        (
            FULL,
            7.0,
            "left a log that ends before its flight",
            "uav1 flew 7 s and left a log that ends before its flight",
            "log ends before its flight",
            "uav1 left a log that ends before its flight",
        ),
        (FULL, 0.0, "did not fly", "uav1 did not fly", "not flown", "uav1 did not fly"),
        ({}, 7.0, "did not fly", "uav1 did not fly", "not flown", "uav1 did not fly"),
    ],
)
def test_flight_after_the_end_of_the_record_has_taken_place(
    tmp_path, recorder, airborne_s, end, clause, summary, line
):
    run = without_flight(read_run(run_with(tmp_path / "run", recorder, airborne_s)))
    found = happenings(run)
    assert fate_of("uav1", run, found).end == end
    assert clause in verdict(run, found).text
    made = summarise(names=run.names, flights=run.flights, outcome=run.outcome, missing=run.missing)
    (row,) = [text for text in as_text(made).splitlines() if text.startswith("uav1")]
    assert row.endswith(summary)
    (run.folder / "summary.json").write_text(json.dumps(made))
    assert line in lines_of(run.folder)[0]
