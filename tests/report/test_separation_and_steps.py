"""Distances between vehicles, and the steps of a scenario with the steps from which their times count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_flights import make_run

from arena.flight_log.flight import Flight
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


def hovering(name: str, first_s: float, last_s: float, north_m: Callable[[np.ndarray], np.ndarray]) -> Flight:
    """Return the log of a vehicle that takes off in its third row and hovers at 1 m. north_m: position over time [m]."""
    t = np.arange(0.0, last_s - first_s, 1 / 30)
    n = t.size
    numbers = {
        "truth.pos.north": north_m(t + first_s),
        "truth.pos.east": np.zeros(n),
        "truth.pos.down": np.where(np.arange(n) < 3, 0.0, -1.0),
        "info.is_armed": np.ones(n),
        "info.is_landed": np.zeros(n),
    }
    armed, landed = np.ones(n, bool), np.zeros(n, bool)
    return Flight(
        name=name, t=t, t0=first_s, numbers=numbers, mode=["OFFBOARD"] * n, armed=armed, landed=landed
    )


@pytest.mark.parametrize("near_s", [20.0, 130.0])
def test_separation_before_and_after_the_log_with_the_most_rows_counts(near_s):
    logs = [
        hovering("uav1", 40.0, 110.0, lambda t: np.full(t.size, -50.0)),
        hovering("uav2", 0.0, 65.0, lambda t: np.zeros(t.size)),
        hovering("uav3", 0.0, 65.0, lambda t: np.where(abs(t - near_s) < 1.0, 0.2, 5.0)),
        hovering("uav4", 85.0, 150.0, lambda t: np.full(t.size, 9.0)),
        hovering("uav5", 85.0, 150.0, lambda t: np.where(abs(t - near_s) < 1.0, 9.2, 15.0)),
    ]
    flights = {log.name: log for log in logs}
    vehicles = drawn(flights, dict.fromkeys(flights, 0.0))
    found = smallest(distances(vehicles), vehicles)
    assert found is not None and found.distance_m == pytest.approx(0.2)
    assert found.names == (("uav2", "uav3") if near_s < 75.0 else ("uav4", "uav5"))
    assert found.at_s == pytest.approx(near_s, abs=1.1)


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
