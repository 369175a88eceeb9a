"""report.html of complete runs, of runs with events, and of incomplete runs: contents of the page and data of its figures."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_flights import flight_csv, make_run
from report_payload import payload, traces

from arena.report import vehicle_rows
from arena.report.run_data import read_run
from arena.report.run_page import run_page
from arena.report.run_report import main

REFUSED = {"vehicle": "uav1", "role": "ground station", "request": "arm", "refused": "it flies"}


def add_events(run: Path, *lines: dict[str, Any]) -> Path:
    """Write events.jsonl with these lines. t: simulation time [s]."""
    entries = [{"t": "2027-01-15T08:00:10+00:00", "mono": 1.0, **line} for line in lines]
    (run / "events.jsonl").write_text("".join(json.dumps(e) + "\n" for e in entries))
    return run


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the page of two vehicles; uav2 lost its motion capture, its failsafe acted, and a rotor fault crashed uav1."""
    run = make_run(tmp_path_factory.mktemp("page") / "run", vehicles=2)
    add_events(
        run,
        {"process": "mocap", "event": "fault: uav2 is not tracked", "time_s": 10.0},
        {"process": "router", "event": "uav2: Failsafe activated: external vision lost", "time_s": 11.0},
        {"process": "world", "event": "uav1 crashed: touched a wall at 12.50 s", "time_s": 12.5},
        {"process": "router", "audit": REFUSED, "time_s": 12.6},
    )
    return run_page(read_run(run))


def test_verdict_names_fates_faults_and_failsafes(flown):
    head = flown[: flown.index("<section")]
    assert "uav1 flew 6 s and crashed (touched a wall at 12.50 s)" in head
    assert "uav2 flew 6 s and landed" in head
    assert "at 10.0 s uav2 lost its motion capture (injected fault), and its failsafe switched to" in head
    assert "AUTO.LAND (external vision lost) 1.0 s later" in head


def test_programs_that_end_together_share_a_row(tmp_path):
    ended = {"from": "READY", "to": "FATAL", "reason": "exit 1", "time_s": 10.0}
    run = add_events(
        make_run(tmp_path / "run", vehicles=2), *({"process": f"program.uav{k}", **ended} for k in (1, 2))
    )
    assert "each vehicle&#39;s program ended: exit 1" in run_page(read_run(run))


def test_position_figure_has_actual_and_desired_values(flown):
    (actual,) = [t for t in traces(flown, "position", vehicle="uav1", curve="actual") if t["yaxis"] == "y2"]
    (desired,) = [t for t in traces(flown, "position", vehicle="uav1", curve="desired") if t["yaxis"] == "y2"]
    assert actual["x"][0] == pytest.approx(5.0) and actual["x"].size == 300
    assert actual["y"][:180] == pytest.approx(0.05)  # 5 cm east of the setpoint
    assert (
        np.nanmax(np.abs(desired["y"])) == 0.0 and np.isnan(desired["y"][200:]).all()
    )  # OFFBOARD ends at row 180
    (height,) = [t for t in traces(flown, "position", vehicle="uav1", curve="actual") if t["yaxis"] == "y3"]
    assert height["y"][:180] == pytest.approx(1.0)


def test_error_figures_have_the_errors_of_the_flight(flown):
    (distance,) = [t for t in traces(flown, "tracking", vehicle="uav2", curve="distance")]
    assert distance["y"][100] == pytest.approx(0.05, abs=1e-4)
    (north,) = [t for t in traces(flown, "estimator", vehicle="uav2", curve="north")]
    assert north["y"][100] == pytest.approx(10.0, abs=0.1)  # the estimate is 10 mm north of the truth
    (table,) = re.findall(r'<section id="estimator">.*?</table>', flown, re.DOTALL)
    assert "north [mm]" in table and ">10.0<" in table  # the unit of the figure


def test_map_has_height_up_and_the_room(flown):
    (path,) = traces(flown, "map", vehicle="uav1", curve="path")
    assert (path["x"][0], path["y"][0], path["z"][0]) == pytest.approx(
        (0.05, 0.0, 1.0)
    )  # east, north, height
    layout = payload(flown)["figures"]["map"]["layout"]["scene"]
    assert [layout[f"{a}axis"]["range"] for a in "xyz"] == [[-2.0, 2.0], [-3.5, 3.5], [0.0, 3.0]]
    ratio = layout["aspectratio"]
    assert ratio["y"] / ratio["x"] == pytest.approx(7.0 / 4.0)  # equal scales


def test_timeline_has_the_modes_and_the_marks(flown):
    data = {t["name"]: t for t in payload(flown)["figures"]["timeline"]["data"]}
    offboard, land = data["OFFBOARD"], data["AUTO.LAND"]
    assert offboard["y"] == ["uav1", "uav2"] and offboard["base"][0] == pytest.approx(5.0)
    assert offboard["x"][0] == pytest.approx(6.0, abs=0.05) and land["x"][0] == pytest.approx(2.0, abs=0.05)
    assert (data["failsafe"]["x"], data["failsafe"]["y"]) == ([11.0], ["uav2"])
    assert (data["crash"]["x"], data["crash"]["y"]) == ([12.5], ["uav1"])
    assert data["injected fault"]["x"] == [10.0]


def test_numbers_jump_to_their_moment(flown):
    assert re.search(r'data-t="10.000" data-chart="timeline"[^>]*>10.00 s<', flown)
    rows = re.findall(r'data-t="([\d.]+)" data-chart="tracking" data-vehicle="uav1"[^>]*>([\d.]+)<', flown)
    assert ("0.050" in {number for _, number in rows}) and all(5.0 <= float(t) <= 15.0 for t, _ in rows)


def test_refused_requests_are_listed(flown):
    assert "arm requested by ground station refused: it flies" in flown


def test_figures_are_valid_for_plotly(flown):
    import plotly.graph_objects as go

    figures = payload(flown)["figures"]
    assert {"timeline", "map", "height", "position", "tracking", "estimator", "processes"} <= figures.keys()
    for figure in figures.values():
        assert go.Figure(figure).data  # raises ValueError for an unknown property


def test_time_axes_are_equal(flown):
    layouts = [
        f["layout"] for name, f in payload(flown)["figures"].items() if name not in ("map", "processes")
    ]
    assert len({(layout["margin"]["l"], layout["margin"]["r"]) for layout in layouts}) == 1
    assert payload(flown)["options"]["time"] == [pytest.approx(5.0), pytest.approx(5.0 + 299 / 30, abs=1e-3)]


def test_page_needs_no_network(flown):
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", flown)
    assert "<link" not in flown and "@import" not in flown


def test_landing_error_without_a_landing_time_has_a_page(tmp_path, monkeypatch):
    """A vehicle that was armed and never left the floor has a landing error, and neither touchdown nor landing."""
    monkeypatch.setattr(vehicle_rows, "flown_times", lambda flight: [])
    whole = vehicle_rows.analyse
    monkeypatch.setattr(
        vehicle_rows,
        "analyse",
        lambda *a, **k: (found := whole(*a, **k)) | {"landing": found["landing"] | {"error_m": 0.0}},
    )
    assert '<td class="n">0.000 m</td>' in run_page(read_run(make_run(tmp_path / "run")))


def test_texts_from_yaml_and_the_air_are_escaped(tmp_path):
    evil = "<script>alert(1)</script>"
    run = make_run(tmp_path / "run")
    plan = json.loads((run / "plan.json").read_text())
    (run / "plan.json").write_text(json.dumps({**plan, "name": evil}))
    outcome = json.loads((run / "outcome.json").read_text())
    outcome |= {"name": evil, "cause": "x", "reason": evil}
    outcome["processes"][evil] = {**outcome["processes"]["world"], "exit": evil, "stats": {}}
    (run / "outcome.json").write_text(json.dumps(outcome))
    add_events(
        run,
        {"process": "router", "event": f"uav1: Failsafe activated: {evil}", "time_s": 9.0},
        {"process": evil, "event": f"</script>{evil}", "time_s": 9.5},
    )
    page = run_page(read_run(run))
    assert evil not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    marks = next(t for t in payload(page)["figures"]["timeline"]["data"] if t["name"] == "failsafe")
    assert "<script>" not in marks["text"][0]  # plotly would interpret tags


def test_incomplete_run_has_a_page(tmp_path):
    run = make_run(tmp_path / "run", vehicles=2)
    (run / "outcome.json").unlink()
    (run / "csv" / "uav2.csv").write_text("")
    assert main([str(run)]) == 0
    page = (run / "report.html").read_text()
    assert "the run has no outcome: the supervisor was killed, or could not write it" in page
    assert "no log of uav2" in page and "uav2 left no log" in page
    assert traces(page, "position", vehicle="uav1") and not traces(page, "position", vehicle="uav2")


def test_empty_run_has_a_page(tmp_path):
    assert main([str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text()
    assert payload(page)["figures"] == {} and "plan.json" in page


def test_real_vehicle_is_shown_with_motion_capture_on_its_own_time_axis(tmp_path):
    run = make_run(tmp_path / "run")
    began = 1_800_000_000.0  # the start in outcome.json, as Unix time
    head, *rows = flight_csv(real=True).splitlines(keepends=True)
    shifted = [f"{began + float(row.partition(',')[0]):.4f},{row.partition(',')[2]}" for row in rows]
    (run / "csv" / "uav1.csv").write_text(head + "".join(shifted))
    plan = {
        "name": "lab",
        "vehicles": [{"name": "uav1", "simulated": False, "autopilot": "hardware"}],
        "slices": {},
    }
    (run / "plan.json").write_text(json.dumps(plan))
    add_events(
        run,
        {
            "process": "router",
            "event": "uav1: pilot has control: POSCTL",
            "t": "2027-01-15T08:00:07.500+00:00",
            "time_s": 1.0,
        },
    )
    page = run_page(read_run(run))
    (north,) = [t for t in traces(page, "position", curve="actual") if t["yaxis"] == "y"]
    assert north["x"][0] == pytest.approx(5.0, abs=0.01)  # seconds since the start of the run
    assert "motion capture" in page and "at 7.5 s uav1: pilot has control: POSCTL" in page
    assert "real flight controller" in page


def test_long_logs_are_thinned_without_losing_the_largest_error(tmp_path):
    run = make_run(tmp_path / "run")
    head, *rows = flight_csv().splitlines(keepends=True)
    stamps = [5.0 + k / 2000 for k in range(45_000)]
    column = head.split(",").index("truth.pos.east")
    cells = rows[100].split(",")
    lines = [",".join([f"{t:.4f}", *cells[1:]]) for t in stamps]
    peak = cells.copy()
    peak[column] = "0.9"
    lines[33_333] = ",".join([f"{stamps[33_333]:.4f}", *peak[1:]])
    (run / "csv" / "uav1.csv").write_text(head + "".join(lines))
    page = run_page(read_run(run))
    (distance,) = traces(page, "tracking", vehicle="uav1", curve="distance")
    assert distance["y"].size < 30_000 and np.nanmax(distance["y"]) == pytest.approx(0.9, abs=1e-3)


def test_program_that_failed_is_named_with_its_error_and_the_end_of_the_run(tmp_path):
    run = make_run(tmp_path / "run")
    outcome = json.loads((run / "outcome.json").read_text())
    outcome |= {"exit_code": 1, "cause": "time limit", "reason": "the time limit of 90 s has passed"}
    (run / "outcome.json").write_text(json.dumps(outcome))
    last = "last line of its log: arena.errors.OffboardLostError: uav1: it left OFFBOARD. The program does not continue"
    add_events(
        run,
        {"process": "program.uav1", "from": "READY", "to": "EXITED", "reason": "exit 1", "time_s": 9.0},
        {"process": "program.uav1", "event": last, "time_s": 9.0},
    )
    page = run_page(read_run(run))
    assert "program.uav1 ended with exit 1 at 9.0 s (OffboardLostError: uav1: it left OFFBOARD)" in page
    assert "the run ended: the time limit of 90 s has passed" in page


def test_killed_process_that_came_back_was_started_again(tmp_path):
    run = add_events(
        make_run(tmp_path / "run"),
        {
            "process": "router",
            "from": "STOPPED",
            "to": "STARTING",
            "reason": "its needs are ready",
            "time_s": 1.0,
        },
        {
            "process": "router",
            "from": "READY",
            "to": "BACKOFF",
            "reason": "killed by SIGKILL; again in 0.25 s",
            "time_s": 8.5,
        },
        {
            "process": "router",
            "from": "BACKOFF",
            "to": "STARTING",
            "reason": "backoff is over",
            "time_s": 8.8,
        },
    )
    assert "router ended with killed by SIGKILL at 8.5 s and was started again" not in run_page(read_run(run))
    assert "router was killed by SIGKILL at 8.5 s and was started again" in run_page(read_run(run))


def test_end_of_a_fault_is_its_duration(tmp_path):
    run = add_events(
        make_run(tmp_path / "run", vehicles=2),
        {"process": "mocap", "event": "fault: uav1 is not tracked", "time_s": 8.0},
        {"process": "mocap", "event": "fault: uav2 is not tracked", "time_s": 8.1},
        {"process": "mocap", "event": "fault: uav1 is tracked again", "time_s": 8.4},
        {"process": "mocap", "event": "fault: uav2 is tracked again", "time_s": 8.5},
    )
    page = run_page(read_run(run))
    assert "at 8.0 s uav1 and uav2 lost their motion capture (injected fault) for 0.4 s" in page
    assert "uav1 is tracked again (injected fault)" not in page


def test_scenario_steps_are_on_the_time_axis(tmp_path):
    run = make_run(tmp_path / "run")
    place = {"file": "hover.smoke.yaml", "line": 5}
    steps = [
        {
            "place": {**place, "text": "mocap dropout uav1"},
            "outcome": "passed",
            "kind": "do",
            "begun_s": 8.0,
            "done_s": 8.1,
        },
        {
            "place": {**place, "text": "uav1.landed"},
            "outcome": "failed",
            "begun_s": 8.1,
            "failure": "uav1 flew on",
        },
    ]
    verdict = {
        "steps": steps,
        "rules": [
            {
                "place": {**place, "text": "inside geofence"},
                "outcome": "passed",
                "worst": -1.265,
                "unit": "m",
                "at_s": 9.74,
                "who": "uav1",
            },
        ],
        "problems": [],
        "touchdowns": [],
        "lasted_s": 9.0,
        "ended": "a step failed",
    }
    result = {
        "passed": False,
        "scenario": "hover <1>",
        "file": "hover.smoke.yaml",
        "seed": 3,
        "verdict": verdict,
    }
    (run / "scenario.json").write_text(json.dumps(result))
    page = run_page(read_run(run))
    (marks,) = [t for t in payload(page)["figures"]["timeline"]["data"] if t["name"] == "scenario step"]
    assert (marks["x"], marks["text"]) == ([8.1], ["1, 2"]), "circles at the same place are one"
    assert "mocap dropout uav1" in marks["customdata"][0] and "uav1.landed" in marks["customdata"][0]
    assert "<td>step 1, 8.10 s</td>" in page, "the time of the expectation counts from the fault"
    assert "FAILED: uav1 flew 6 s and landed" in page and "hover.smoke.yaml:5: uav1 flew on" in page
    assert "inside geofence" in page and re.search(r"1\.2[67] m inside \(\w+\)", page)
