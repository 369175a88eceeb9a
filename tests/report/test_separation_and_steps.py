"""Distances between vehicles, and the steps of a scenario with the steps from which their times count."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_flights import make_run

from arena.report.figures import drawn
from arena.report.run_data import RunData, read_run
from arena.report.scenario_rows import scenario_rows
from arena.report.scenario_steps import scenario_steps
from arena.report.separation import distances, smallest


@pytest.fixture
def run(tmp_path: Path) -> RunData:
    return read_run(make_run(tmp_path / "run", vehicles=2))


def vehicles_of(run: RunData, east_m: np.ndarray):
    """Return both vehicles; the second one is `east_m` (n,) east of the first."""
    second = run.flights["uav2"]
    numbers = {**second.numbers, "truth.pos.east": second.numbers["truth.pos.east"] + east_m}
    flights = {**run.flights, "uav2": replace(second, numbers=numbers)}
    return drawn(flights, dict.fromkeys(flights, 0.0))


def test_smallest_separation_has_its_time_and_the_pair(run):
    east = np.full(run.flights["uav1"].t.size, 3.0)
    east[100], east[250] = 0.7, 0.2  # row 250: both vehicles are on the floor, which does not count
    vehicles = vehicles_of(run, east)
    found = smallest(distances(vehicles), vehicles)
    assert found is not None and found.distance_m == pytest.approx(0.7)
    assert found.at_s == pytest.approx(vehicles[0].t[100]) and found.names == ("uav1", "uav2")


def test_one_vehicle_has_no_separation(run):
    vehicles = vehicles_of(run, np.zeros(run.flights["uav1"].t.size))
    assert distances(vehicles[:1]) is None and smallest(None, vehicles[:1]) is None


def entry(text: str, kind: str, begun: float | None, done: float | None, outcome: str = "passed"):
    place = {"file": "s.smoke.yaml", "line": 3, "text": text}
    return {"place": place, "kind": kind, "begun_s": begun, "done_s": done, "outcome": outcome}


def test_time_of_an_expectation_counts_from_the_step_that_began_with_it(run):
    steps = [
        entry("at uav1.airborne: kill program uav1", "do", 6.0, 6.0),
        entry("uav1.landed within 9 s", "expect", 6.0, 12.0),
        entry("uav2.mode == OFFBOARD for 4 s", "expect", 6.0, 10.0),
        entry("at uav2.mode == LAND", "at", 12.0, 12.0),
        entry("uav2.landed within 8 s", "expect", 12.0, 14.0),
    ]
    told = replace(run, scenario={"scenario": "s", "verdict": {"steps": steps}})
    found = [(s.number, s.at_s, s.since, s.text.split()[0]) for s in scenario_steps(told)]
    assert found == [
        (1, 6.0, 0, "at"),
        (2, 10.0, 1, "uav2.mode"),
        (3, 12.0, 1, "uav1.landed"),  # in the order of the file, not of the alphabet
        (4, 12.0, 0, "at"),
        (5, 14.0, 4, "uav2.landed"),
    ]


def test_failed_step_is_listed_when_it_failed(run):
    late = {**entry("uav1.landed within 0.5 s", "expect", 6.0, None, "failed"), "failed_s": 6.5}
    steps = [late, entry("at uav1.airborne: kill program uav1", "do", 6.0, 6.0)]
    told = replace(run, scenario={"scenario": "s", "verdict": {"steps": steps}})
    assert [(s.at_s, s.good) for s in scenario_steps(told)] == [(6.0, True), (6.5, False)]


def test_rule_that_was_not_checked_is_neither_good_nor_bad(run):
    place = {"text": "all vehicles have landed at the end"}
    rules = [{"place": place, "outcome": outcome} for outcome in ("passed", "failed", "not reached")]
    told = replace(run, scenario={"scenario": "s", "verdict": {"rules": rules}})
    assert [(row["level"], row["result"]) for row in scenario_rows(told)["rules"]] == [
        ("good", "passed"),
        ("bad", "FAILED"),
        ("soft", "not checked: the scenario failed before"),
    ]


def test_rule_leads_to_the_figure_of_its_quantity_and_its_vehicles(run):
    rules = [
        {"place": {"text": text}, "outcome": "passed", "worst": 1.0, "unit": unit, "at_s": 6.0, "who": who}
        for text, unit, who in (
            ("each.tilt < 20 deg", "deg", "uav2"),
            ("separation > 1 m", "m", "uav1 and uav2"),
            ("each.battery > 20 %", "%", "uav1"),
            ("inside geofence", "m", "uav1"),
        )
    ]
    told = replace(run, scenario={"scenario": "s", "verdict": {"rules": rules}})
    rows = scenario_rows(told)["rules"]
    assert [(row["chart"], row["vehicles"]) for row in rows] == [
        ("attitude", ["uav2"]),
        ("separation", ["uav1", "uav2"]),
        ("battery", ["uav1"]),
        ("position", ["uav1"]),
    ]
    assert rows[3]["worst"] == "1.00 m outside (east)"
