"""Two flights on one time axis: alignment, differences, and the page that shows both."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_flights import flight_csv, make_run
from report_payload import payload, traces

import arena.cli as cli
from arena.errors import InputError
from arena.flight_log.flight import Flight, read_flight
from arena.flight_log.open import read_flights
from arena.report.analysis import analyse
from arena.report.comparison_page import comparison_page, read_source
from arena.report.flight_pair import difference, moment_row, pairs
from arena.report.pair_figures import pair_figures

THESIS = Path(__file__).parents[3] / "shared" / "data" / "thesis"


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    file = tmp_path / "uav1.csv"
    file.write_text(flight_csv())
    found = read_flight(file)
    assert found is not None
    return found


def moved(flight: Flight, by_n: tuple[float, float, float], later_s: float = 0.0) -> Flight:
    """Return the flight as it would be at another place and time. by_n: offset of all positions [m] [NED]."""
    numbers = dict(flight.numbers)
    for group in ("truth.pos", "mocap.pos", "ekf.pos", "pos_ref"):
        for part, offset in zip(("north", "east", "down"), by_n, strict=True):
            numbers[f"{group}.{part}"] = numbers[f"{group}.{part}"] + offset
    return replace(flight, numbers=numbers, t0=flight.t0 + later_s)


def test_same_flight_at_another_place_and_time_has_no_difference(flight):
    (pair,) = pairs([flight], [moved(flight, (2.0, -1.0, 0.3), later_s=1000.0)], ("a", "b"))
    found = difference(pair).measures()["distance"]
    assert found is not None and found.max == pytest.approx(0.0, abs=1e-9)


def test_time_in_the_air_is_that_of_the_summary(flight):
    landed = (flight.t > 7.0).astype(float)  # reported 1 s after the touchdown
    slow = replace(flight, landed=landed == 1.0, numbers={**flight.numbers, "info.is_landed": landed})
    (pair,) = pairs([slow], [slow], ("a", "b"))
    (row,) = [row for row in pair_figures(pair) if row[0] == "time in the air"]
    assert row[3] == pytest.approx(analyse(slow)["in_air_s"], abs=0.01)
    assert row[3] == pytest.approx(6.0, abs=0.05)


def test_difference_is_b_minus_a_with_its_moment(flight):
    other = moved(flight, (0.0, 0.0, 0.0))
    rows = flight.t > 4.0
    other.numbers["truth.pos.east"][rows] += 0.3
    (pair,) = pairs([flight], [other], ("a", "b"), "offboard")
    found = difference(pair)
    assert found.position[found.t < 3.9, 1] == pytest.approx(0.0, abs=1e-9)
    assert found.position[found.t > 4.1, 1] == pytest.approx(0.3, abs=1e-9)
    measures = found.measures()["distance"]
    assert measures is not None and measures.at_s == pytest.approx(4.0, abs=0.1)


def test_flight_that_began_later_in_its_log_is_aligned(flight):
    keep = slice(30, None)  # this log begins 1 s later
    other = replace(
        flight,
        t=flight.t[keep] - flight.t[30],
        numbers={name: values[keep] for name, values in flight.numbers.items()},
        mode=flight.mode[keep],
        armed=flight.armed[keep],
        landed=flight.landed[keep],
    )
    (pair,) = pairs([flight], [other], ("a", "b"))
    assert pair.moment == "step"  # the step to 1 m north; both logs contain it
    assert (pair.a.zero_s, pair.b.zero_s) == (pytest.approx(3.0, abs=0.05), pytest.approx(2.0, abs=0.05))


def test_moments_of_a_flight(flight):
    assert moment_row(flight, "offboard") == 0
    assert flight.t[moment_row(flight, "step")] == pytest.approx(3.0, abs=0.05)
    assert moment_row(replace(flight, armed=np.zeros(flight.t.size, bool)), "takeoff") is None


def test_missing_moment_is_an_input_error_that_names_the_others(flight):
    without = replace(flight, mode=["POSCTL"] * flight.t.size)
    with pytest.raises(InputError, match=r"does not contain the event .offboard.*Choose one of: takeoff"):
        pairs([flight], [without], ("a", "b"), "offboard")


def test_yaw_difference_across_the_jump_of_the_angle(flight):
    other = moved(flight, (0.0, 0.0, 0.0))
    turn = np.where(flight.t > 1.0, np.radians(-179.0), 0.0)
    other.numbers["truth.att_euler.yaw"] = turn
    mine = moved(flight, (0.0, 0.0, 0.0))
    mine.numbers["truth.att_euler.yaw"] = -turn  # 179 degrees
    (pair,) = pairs([mine], [other], ("a", "b"), "offboard")
    assert np.nanmax(np.abs(difference(pair).yaw)) == pytest.approx(2.0, abs=0.01)


def test_desired_yaw_is_drawn_next_to_the_actual_yaw(flight):
    one = moved(flight, (0.0, 0.0, 0.0))
    later = np.arange(one.t.size) > one.t.size // 2
    one.numbers["truth.att_euler.yaw"] = np.where(later, np.radians(179.0), 0.0)
    one.numbers["pos_ref.yaw"] = np.where(later, np.radians(-179.0), 0.0)
    (pair,) = pairs([one], [one], ("a", "b"), "takeoff")
    drawn = pair.a.flight
    apart = np.degrees(drawn.numbers["pos_ref.yaw"] - drawn.euler[:, 2])
    assert apart[later] == pytest.approx(2.0, abs=0.01)


def test_page_overlays_both_flights_and_lists_settings_that_differ(tmp_path, monkeypatch, capsys):
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b")
    (a / "arena.yaml").write_text("vehicles: {uav1: {params: {MPC_XY_P: 0.95}}}\n")
    (b / "arena.yaml").write_text("vehicles: {uav1: {params: {MPC_XY_P: 0.5}}}\n")
    monkeypatch.chdir(tmp_path)
    assert cli.main(["report", str(a), str(b)]) == 0
    assert capsys.readouterr().out.strip() == "comparison.html"
    page = (tmp_path / "comparison.html").read_text()
    names = {t["name"] for t in traces(page, "position", vehicle="uav1", curve="actual")}
    assert names == {"A: uav1 of a actual", "B: uav1 of b actual"}
    (distance, *_) = payload(page)["figures"]["difference"]["data"]
    assert np.nanmax(distance["y"]) == 0.0
    assert "vehicles.uav1.params.MPC_XY_P" in page and ">0.95<" in page and ">0.5<" in page


def test_vehicle_of_only_one_run_is_one_row_of_the_settings(tmp_path):
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b")
    (a / "arena.yaml").write_text("log: {ulog: null}\nvehicles: {uav1: {id: 1}}\n")
    (b / "arena.yaml").write_text(
        "log: {ulog: true}\nvehicles: {uav1: {id: 1}, uav2: {id: 2, port: 16002}}\n"
    )
    assert cli.main(["report", str(a), str(b), "-o", str(tmp_path / "c.html")]) == 0
    page = (tmp_path / "c.html").read_text()
    rows = re.findall(
        r"<tr><td>((?:vehicles|log)[^<]*)</td><td class=\"text\">([^<]*)</td>.*?>([^<]*)</td>", page
    )
    assert rows == [("log.ulog", "not set", "true"), ("vehicles.uav2", "not in this run", "in this run")]


def test_one_vehicle_of_a_run_is_chosen_by_name(tmp_path):
    run = make_run(tmp_path / "run", vehicles=2)
    assert [f.name for f in read_source(f"{run}:uav2").flights] == ["uav2"]
    with pytest.raises(InputError, match="expected one of: uav1, uav2"):
        read_source(f"{run}:uav3")


def test_unknown_moment_is_an_input_error(tmp_path, capsys):
    run = str(make_run(tmp_path / "run"))
    assert cli.main(["report", run, run, "--align", "noon", "-o", str(tmp_path / "x.html")]) == 2
    assert "step, offboard, takeoff" in capsys.readouterr().err


def test_runs_of_ten_vehicles_show_one_pair_first(tmp_path):
    a, b = make_run(tmp_path / "a", vehicles=10), make_run(tmp_path / "b", vehicles=9)
    page = comparison_page(read_source(str(a)), read_source(str(b)))
    assert len(payload(page)["options"]["vehicles"]) == 9
    assert "there is no partner: uav10" in page and len(page) < 10_000_000


@pytest.mark.skipif(not THESIS.is_dir(), reason="the thesis's data are not on this machine")
def test_thesis_flights_differ_as_published():
    """RMS per axis of Gazebo against the real flight, as in the README of the data: 0.126, 0.139, 0.057 m."""
    a, b = (read_flights(THESIS / f"setpoints_{name}.csv") for name in ("gazebo_uav2", "real_uav3"))
    (pair,) = pairs(a, b, ("gazebo", "real"))
    found = difference(pair).measures()
    assert [found[k].rms for k in ("north", "east", "up")] == pytest.approx([0.126, 0.139, 0.057], abs=0.003)
