"""Reports of complete and of incomplete runs."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from recorded_flights import flight_csv, make_run

from arena.flight_log.csv_file import header
from arena.flight_log.flight import read_flight
from arena.report.figures import drawn
from arena.report.happenings import happenings
from arena.report.run_data import Event, read_run
from arena.report.run_report import crashes, main, report, summarise
from arena.report.summary import as_text
from arena.report.vehicle_rows import vehicle_row


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    run = make_run(tmp_path_factory.mktemp("whole") / "run", vehicles=2)
    text = report(run)
    return run, text, json.loads((run / "summary.json").read_text())


def test_figures_are_those_of_the_flight(whole):
    uav1 = whole[2]["vehicles"]["uav1"]
    assert uav1["tracking"]["rms_m"] == pytest.approx(0.05, abs=1e-3)
    assert (uav1["setpoints"]["count"], uav1["setpoints"]["worst_m"]) == (2, pytest.approx(0.05, abs=1e-3))
    assert uav1["landing"]["landed"] and uav1["landing"]["error_m"] == pytest.approx(0.12, abs=1e-3)
    assert uav1["landing"]["target_ne"] == [1.0, 0.0]
    assert uav1["estimator"]["pos_rms_m"] == pytest.approx(0.01, abs=1e-4)
    assert uav1["log_hz"] == pytest.approx(30, abs=0.1)
    assert [(m["mode"], m["armed"]) for m in uav1["modes"]] == [
        ("OFFBOARD", True),
        ("AUTO.LAND", True),
        ("AUTO.LAND", False),
    ]
    assert uav1["airborne_after_s"] == 6.0 and whole[2]["first_airborne_s"] == 6.0
    assert whole[2]["vehicles"]["uav2"]["airborne_after_s"] == 7.0


def test_steps_of_the_report_are_shown_while_it_is_made(tmp_path):
    steps = []
    report(make_run(tmp_path / "run", vehicles=2), steps.append)
    assert steps == ["reading the record", "drawing report.html: 2 vehicles"], "the run has no record"


def test_take_off_and_time_in_the_air_are_those_of_the_page(whole):
    run = read_run(whole[0])
    for one in drawn(run.flights, {name: run.origin_s for name in run.flights}):
        row, found = vehicle_row(one, run, happenings(run)), whole[2]["vehicles"][one.name]
        assert found["took_off_s"] == pytest.approx(row["took_off_s"], abs=2e-3) and found["took_off_s"] > 0.0
        assert found["in_air_s"] == pytest.approx(row["fate"].flown_s, abs=0.01) and found["in_air_s"] > 1.0
    head = next(line for line in whole[1].splitlines() if line.startswith("vehicle"))
    assert "took off" in head and "airborne" not in head


def test_text_has_the_main_figures(whole):
    assert whole[1] == (whole[0] / "summary.txt").read_text().rstrip("\n")
    for words in ("uav2", "0.050", "landed", "p99 0.40 ms", "0.998", "exit 0", "AUTO.LAND"):
        assert words in whole[1]
    assert "missing" not in whole[1]


def test_killed_supervisor_is_named(tmp_path):
    run = make_run(tmp_path / "run")
    (run / "outcome.json").unlink()
    text = report(run)
    assert "the supervisor was killed, or could not write it" in text and "missing: outcome.json" in text
    assert json.loads((run / "summary.json").read_text())["vehicles"]["uav1"]["tracking"]["rms_m"]


def test_vehicle_without_a_log_is_named(tmp_path):
    run = make_run(tmp_path / "run", vehicles=2)
    (run / "csv" / "uav2.csv").write_text("")
    text = report(run)
    assert "no log of uav2" in text and "no log" in text and "0.050" in text


def test_crash_is_in_the_text(tmp_path):
    run = make_run(tmp_path / "run")
    outcome = json.loads((run / "outcome.json").read_text())
    outcome["processes"]["world"]["stats"]["vehicles"]["uav1"]["crashed"] = "touched a wall at 7.10 s"
    outcome |= {"exit_code": 1, "failed": ["uav1 crashed"]}
    (run / "outcome.json").write_text(json.dumps(outcome))
    assert "crashed: touched a wall at 7.10 s" in report(run)


def test_crash_of_a_run_without_outcome_is_in_the_summary(tmp_path):
    run = make_run(tmp_path / "run", vehicles=2)
    (run / "outcome.json").unlink()
    crash = {"time_s": 10.9, "process": "world", "event": "uav1 crashed: touched a wall at 10.90 s"}
    (run / "events.jsonl").write_text(json.dumps(crash) + "\n")
    lines = [line for line in report(run).splitlines() if line.startswith("uav")]
    assert lines[0].endswith("crashed: touched a wall at 10.90 s") and lines[1].endswith(" landed")
    vehicles = json.loads((run / "summary.json").read_text())["vehicles"]
    assert vehicles["uav1"]["crashed"] == "touched a wall at 10.90 s" and not vehicles["uav2"]["crashed"]


def test_crash_of_a_replayed_flight_is_in_the_summary(tmp_path):
    data = read_run(make_run(tmp_path / "run"))
    crash = Event(at_s=10.9, process="world", text="uav1 crashed: touched a wall at 10.90 s")
    replay = replace(data, plan={**data.plan, "replay": "/runs/a/flight.mcap"}, outcome={}, events=[crash])
    assert crashes(replay) == {"uav1": "touched a wall at 10.90 s"}


@pytest.mark.parametrize(
    ("factor", "asked", "slow"),
    [(0.65, 1.0, True), (0.99, 1.0, False), (3.0, None, False), (None, 1.0, False)],
)
def test_flight_below_real_time_is_in_the_text(factor, asked, slow):
    outcome = {"real_time": {"factor": factor, "asked": asked}}
    expected = "SLOWER THAN REQUESTED: 0.65 simulated seconds per second, 1 was requested"
    assert (expected in as_text(summarise(names=[], flights={}, outcome=outcome, missing=[]))) is slow


@pytest.mark.parametrize("asked", [None, 1.0])
def test_lateness_of_steps_is_stated_only_for_a_requested_speed(tmp_path, asked):
    run = make_run(tmp_path / "run")
    outcome = json.loads((run / "outcome.json").read_text())
    (run / "outcome.json").write_text(json.dumps({**outcome, "real_time": {"factor": 1.98, "asked": asked}}))
    assert ("step lateness" in report(run)) is (asked is not None)


@pytest.mark.parametrize("broken", ["", "{", "[]", '{"processes": {}}'])
def test_broken_records_are_no_traceback(tmp_path, broken):
    (tmp_path / "outcome.json").write_text(broken)
    (tmp_path / "plan.json").write_text(broken)
    assert main([str(tmp_path)]) == 0
    assert (tmp_path / "summary.json").exists()


def test_missing_run_folder_is_an_input_error(tmp_path, capsys):
    assert main([str(tmp_path / "nowhere")]) == 2
    assert "run folder" in capsys.readouterr().err


def make_real_run(folder, *, captured: bool):
    """Write a run of a real vehicle that flew and one that was never switched on."""
    run = make_run(folder, vehicles=2)
    (run / "csv" / "uav1.csv").write_text(flight_csv(real=True, captured=captured))
    (run / "csv" / "uav2.csv").write_text(header(simulated=False))
    plan = json.loads((run / "plan.json").read_text())
    (run / "plan.json").write_text(
        json.dumps({**plan, "slices": {"link.uav1": {"preflight": {"size_m": [7.0, 4.0, 3.0]}}}})
    )
    outcome = json.loads((run / "outcome.json").read_text())
    del outcome["processes"]["world"]
    (run / "outcome.json").write_text(json.dumps(outcome))
    return run


def test_real_vehicle_is_judged_by_motion_capture(tmp_path):
    run = make_real_run(tmp_path / "run", captured=True)
    text = report(run)
    uav1 = json.loads((run / "summary.json").read_text())["vehicles"]["uav1"]
    assert (uav1["judged_by"], uav1["crashed"], uav1["verdict"]) == ("capture", None, None)
    assert uav1["tracking"]["rms_m"] == pytest.approx(0.05, abs=1e-3)
    assert uav1["landing"]["landed"] and uav1["landing"]["error_m"] == pytest.approx(0.12, abs=1e-3)
    assert uav1["landing"]["target_ne"] == [1.0, 0.0]
    assert uav1["estimator"]["pos_rms_m"] == pytest.approx(0.01, abs=1e-4)
    assert uav1["estimator"]["yaw_rms_deg"] == pytest.approx(0.0, abs=1e-6)
    assert "capture" in text and "landed" in text and "NOT" not in text
    assert "no log of uav2" in text and "no log" in text


def test_real_vehicle_without_cameras_is_judged_by_its_estimate(tmp_path):
    run = make_real_run(tmp_path / "run", captured=False)
    report(run)
    uav1 = json.loads((run / "summary.json").read_text())["vehicles"]["uav1"]
    assert uav1["judged_by"] == "estimate"
    assert uav1["tracking"]["rms_m"] == pytest.approx(0.051, abs=1e-3)  # the estimate is 10 mm off the truth
    assert uav1["estimator"]["pos_rms_m"] is None


def test_vehicle_that_was_never_armed_has_not_flown(tmp_path):
    file = tmp_path / "uav1.csv"
    file.write_text(
        flight_csv(real=True).replace("OFFBOARD,True", "OFFBOARD,False").replace("LAND,True", "LAND,False")
    )
    flight = read_flight(file)
    assert flight is not None
    assert "not flown" in as_text(summarise(names=["uav1"], flights={"uav1": flight}, outcome={}, missing=[]))
