"""Touchdown, landing and disarming of a flight, and the causes of changes of mode."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_flights import make_run

from arena.report import analysis
from arena.report.analysis import analyse, estimator, tracking
from arena.report.errors import estimate_error, norm, tracking_error
from arena.report.fates import fate_of
from arena.report.happenings import disarming_of, happenings, in_air
from arena.report.landings import touchdown_row
from arena.report.link_record import LinkRecord, StatusText
from arena.report.run_data import Event, RunData, read_run
from arena.report.run_report import disarmed_vehicles, summarise
from arena.report.verdict import verdict

LAND_S = 5.0 + 180 / 30  # AUTO.LAND in the log of `make_run`
DISARMED_S = 5.0 + 240 / 30


@pytest.fixture
def run(tmp_path: Path) -> RunData:
    """Return a run of one vehicle that flies in OFFBOARD, lands in AUTO.LAND, and is disarmed."""
    return read_run(make_run(tmp_path / "run"))


def armed_to_the_end(run: RunData, *texts: tuple[float, str]) -> RunData:
    """Return the run with a log that ends before the disarming, and with these STATUSTEXTs. texts: (time [s], text)."""
    flight = run.flights["uav1"]
    known = replace(flight, armed=np.ones(flight.t.size, bool))
    link = LinkRecord(texts=tuple(StatusText(at_s=at, severity=6, text=text) for at, text in texts))
    return replace(run, flights={"uav1": known}, links={"uav1": link})


def disarmed_at(run: RunData, height_m: float) -> RunData:
    """Return the run with a vehicle that is disarmed at this height above the floor, falls, and is then called landed by its autopilot."""
    flight = run.flights["uav1"]
    after = np.clip(flight.t - flight.t[240], 0.0, None)
    down = np.where(flight.t < flight.t[240], -height_m, np.minimum(0.0, 4.9 * after**2 - height_m))
    numbers = {**flight.numbers, "truth.pos.down": down}
    numbers["truth.pos.down"][:20] = 0.0
    return replace(run, flights={"uav1": replace(flight, numbers=numbers)})


@pytest.mark.parametrize("height_m, end", [(1.0, "was disarmed in the air and fell 1.0 m"), (0.15, "landed")])
def test_vehicle_that_falls_after_its_disarming_has_not_landed(run, height_m, end):
    fallen = disarmed_at(run, height_m)
    fate = fate_of("uav1", fallen, happenings(fallen))
    assert (fate.end, fate.level == "bad") == (end, height_m == 1.0)
    assert analyse(fallen.flights["uav1"], disarmed=True)["landing"]["landed"] is (height_m == 0.15)


def changed(run: RunData, **columns: tuple[slice, float]) -> RunData:
    """Return the run with other values in some rows. columns: armed, landed or down -> (rows, value); NaN is unknown."""
    flight = run.flights["uav1"]
    names = {"armed": "info.is_armed", "landed": "info.is_landed", "down": "truth.pos.down"}
    numbers = {name: values.copy() for name, values in flight.numbers.items()}
    for column, (rows, value) in columns.items():
        numbers[names[column]][rows] = value
    flags = {column: numbers[names[column]] == 1.0 for column in ("armed", "landed")}
    return replace(run, flights={"uav1": replace(flight, numbers=numbers, **flags)})


def test_vehicle_that_falls_silent_armed_on_the_floor_was_not_disarmed(run):
    silent = changed(run, armed=(slice(220, None), np.nan), landed=(slice(220, None), np.nan))
    assert disarming_of("uav1", silent) is None and disarmed_vehicles(silent) == []
    assert fate_of("uav1", silent, happenings(silent)).end == "landed but stayed armed"


def test_vehicle_that_falls_silent_in_the_air_was_not_disarmed_there(run):
    silent = changed(run, armed=(slice(100, None), np.nan), landed=(slice(100, None), np.nan))
    assert disarming_of("uav1", silent) is None
    assert fate_of("uav1", silent, happenings(silent)).end == "was still in the air when its log ended"
    assert not analyse(silent.flights["uav1"])["landing"]["landed"]


def test_missing_telemetry_does_not_split_a_flight(run):
    gap = slice(60, 130)
    whole = changed(run, down=(slice(0, 20), 0.0))
    one = changed(whole, armed=(gap, np.nan), landed=(gap, np.nan))
    assert [text for _, text in texts_of(one, "flight")].count("took off") == 1
    assert fate_of("uav1", one, happenings(one)) == fate_of("uav1", whole, happenings(whole))


def test_flight_of_unknown_height_is_a_flight(run):
    below = changed(run, down=(slice(None), -0.05))
    assert fate_of("uav1", below, happenings(below)).end == "did not fly"
    unknown = changed(below, down=(slice(20, 150), np.nan))
    fate = fate_of("uav1", unknown, happenings(unknown))
    assert fate.end == "landed" and fate.flown_s == pytest.approx(160 / 30, abs=0.1)


def test_fall_of_an_earlier_flight_is_reported(run):
    fallen = changed(
        run,
        armed=(slice(80, 120), 0.0),
        landed=(slice(85, 120), 1.0),
        down=(slice(85, 121), -0.05),
    )
    fate = fate_of("uav1", fallen, happenings(fallen))
    assert (fate.end, fate.level) == ("was disarmed in the air and fell 0.9 m", "bad")


@pytest.mark.parametrize("lost", ["events.jsonl", "flight.mcap"])
def test_run_with_an_incomplete_record_is_not_as_planned(tmp_path, lost):
    folder = make_run(tmp_path / "run")
    whole = read_run(folder)
    assert verdict(whole, happenings(whole)).level == "good"
    (folder / "events.jsonl").unlink() if lost == "events.jsonl" else (folder / lost).write_bytes(b"cut")
    incomplete = read_run(folder)
    judged = verdict(incomplete, happenings(incomplete))
    assert judged.level == "warn" and any(lost in cause for cause in judged.causes), judged.causes


@pytest.mark.parametrize(
    ("failed", "level"),
    [([], "warn"), (["program.uav1: exit 1"], "bad"), (["the landing was not confirmed"], "bad")],
)
def test_run_that_ctrl_c_ended_has_failed_only_with_a_failure(run, failed, level):
    stopped = replace(
        run,
        outcome={**run.outcome, "exit_code": 130, "cause": "Ctrl-C", "reason": "Ctrl-C", "failed": failed},
    )
    judged = verdict(stopped, happenings(stopped))
    assert judged.level == level and any("Ctrl-C" in cause for cause in judged.causes)


def texts_of(run: RunData, kind: str) -> list[tuple[float, str]]:
    return [(round(h.at_s, 1), h.text) for h in happenings(run) if h.kind == kind]


def asked(**audit: Any) -> Event:
    return Event(at_s=LAND_S - 0.1, process="router", audit={"vehicle": "uav1", "refused": "", **audit})


def test_disarming_that_only_a_text_reports_counts(run):
    early = armed_to_the_end(run, (5.1, "Armed by external command"), (14.98, "Disarmed by landing"))
    assert fate_of("uav1", early, happenings(early)).end == "landed"
    off = disarming_of("uav1", early)
    assert off is not None and (off.at_s, off.in_log) == (14.98, False)
    assert (15.0, "disarmed") in texts_of(early, "flight")
    found = summarise(
        names=run.names, flights=early.flights, outcome={}, missing=[], disarmed=disarmed_vehicles(early)
    )
    assert found["vehicles"]["uav1"]["landing"]["landed"]


@pytest.mark.parametrize(
    "texts",
    [
        (),
        ((14.0, "Disarmed by landing"), (14.5, "Armed by external command")),
        ((4.0, "Disarmed by landing"),),
    ],
)
def test_vehicle_without_a_newer_disarming_stayed_armed(run, texts):
    late = armed_to_the_end(run, *texts)
    assert disarming_of("uav1", late) is None
    assert fate_of("uav1", late, happenings(late)).end == "landed but stayed armed"
    assert not summarise(
        names=run.names, flights=late.flights, outcome={}, missing=[], disarmed=disarmed_vehicles(late)
    )["vehicles"]["uav1"]["landing"]["landed"]


def test_landing_error_is_known_before_the_disarming(run):
    late = armed_to_the_end(run)
    landing = summarise(names=run.names, flights=late.flights, outcome={}, missing=[])["vehicles"]["uav1"][
        "landing"
    ]
    assert (landing["landed"], landing["error_m"]) == (False, pytest.approx(0.12, abs=1e-3))


def test_touchdown_is_before_the_landing_that_the_detector_reports(run):
    flight = run.flights["uav1"]
    down = flight.pos.copy()
    down[170:180, 2] = -0.05  # on the floor 10 rows before the report
    numbers = {**flight.numbers, "truth.pos.down": down[:, 2]}
    assert touchdown_row(replace(flight, numbers=numbers), 0, 180) == 170


def test_touchdown_landing_and_disarming_are_three_events(run):
    assert texts_of(run, "flight")[-3:] == [
        (LAND_S, "touched the floor"),
        (LAND_S, "landed (reported by the land detector)"),
        (DISARMED_S, "disarmed"),
    ]


def test_time_on_the_floor_is_no_tracking_error(run):
    flight = run.flights["uav1"]
    down, landed = flight.pos[:, 2].copy(), flight.landed.copy()
    down[:60], landed[:30] = -0.05, True  # on the floor for 2 s, of which the land detector reports the first
    waiting = replace(flight, numbers={**flight.numbers, "truth.pos.down": down}, landed=landed)
    assert tracking(waiting)["max_m"] == pytest.approx(0.05, abs=1e-3)
    error = tracking_error(waiting)
    assert np.isnan(error[:60]).all() and np.isfinite(error[60:180]).all()


def test_log_without_a_take_off_has_a_tracking_error(run):
    flight = run.flights["uav1"]
    hover = replace(flight, numbers={**flight.numbers, "truth.pos.down": np.full(flight.t.size, -1.0)})
    assert tracking(hover)["max_m"] == pytest.approx(0.05, abs=1e-3)


def test_commanded_landing_names_the_sender(run):
    told = replace(run, events=[asked(role="program", request="mode AUTO.LAND")])
    assert (LAND_S, "mode OFFBOARD -> AUTO.LAND, commanded by program.uav1") in texts_of(told, "mode")
    judged = verdict(told, happenings(told))
    assert "at 11.0 s program.uav1 commanded AUTO.LAND" in judged.causes and judged.level == "good"


@pytest.mark.parametrize("failsafe", [False, True])
@pytest.mark.parametrize(
    ("settings", "action"),
    [
        ({}, "no failsafe acted"),
        ({"COM_LOW_BAT_ACT": 0}, "configured low battery action: warning only, COM_LOW_BAT_ACT 0"),
        (
            {"COM_LOW_BAT_ACT": 2, "BAT_CRIT_THR": 0.07},
            "configured low battery action: land only at 7 % (BAT_CRIT_THR), COM_LOW_BAT_ACT 2",
        ),
    ],
)
def test_landing_with_a_drained_battery_states_charge_threshold_and_action(run, failsafe, settings, action):
    settings = {"BAT_LOW_THR": 0.5, **settings}
    fault = "fault: the battery drain of uav1 is set to 3.33 %/s"
    events = [
        Event(at_s=6.0, process="world", text=fault),
        asked(role="program", request="mode AUTO.LAND"),
    ]
    if failsafe:
        events.append(Event(at_s=8.0, process="router", text="uav1: Failsafe activated: low battery"))
    slices = {"world.json": {"vehicles": [{"name": "uav1", "params": settings}]}}
    told = replace(run, events=events, plan={**run.plan, "slices": slices})
    words = (
        f"at 11.0 s program.uav1 commanded AUTO.LAND: battery 87 %, warning at 50 % (BAT_LOW_THR); {action}"
    )
    assert (words in verdict(told, happenings(told)).causes) is not failsafe


def test_refused_and_other_requests_are_no_cause(run):
    events = [
        asked(role="program", request="mode AUTO.LAND", refused="it flies"),
        asked(role="program", request="mode AUTO.LOITER"),
        asked(role="program", request="mode AUTO.LAND", vehicle="uav2"),
        replace(asked(role="program", request="mode AUTO.LAND"), at_s=LAND_S - 5.0),
    ]
    assert (LAND_S, "mode OFFBOARD -> AUTO.LAND") in texts_of(replace(run, events=events), "mode")


def test_failsafe_and_its_change_of_mode_are_one_entry(run):
    events = [
        Event(
            at_s=LAND_S - 0.1,
            process="router",
            text="uav1: Failsafe activated: offboard control lost: AUTO.LAND",
        ),
        Event(at_s=LAND_S, process="router", text="uav1: OFFBOARD has ended without a command: AUTO.LAND"),
        asked(role="program", request="mode AUTO.LAND"),
    ]
    told = replace(run, events=events)
    assert texts_of(told, "mode") == [(LAND_S, "mode OFFBOARD -> AUTO.LAND, because of the failsafe")]
    assert verdict(told, happenings(told)).causes == (
        "at 10.9 s the failsafe of uav1 switched to AUTO.LAND (offboard control lost)",
    )


def test_summary_has_the_times_of_the_report(run):
    late = {name: replace(flight, t0=run.origin_s + 0.4) for name, flight in run.flights.items()}
    first_row = summarise(names=run.names, flights=late, outcome={}, missing=[])["vehicles"]["uav1"]
    found = summarise(
        names=run.names, flights=late, outcome={}, missing=[], disarmed=(), origin_s=run.origin_s
    )["vehicles"]["uav1"]
    assert found["modes"][-1]["t_s"] == pytest.approx(first_row["modes"][-1]["t_s"] + 0.4)
    assert found["landing"]["touchdown_s"] == pytest.approx(first_row["landing"]["touchdown_s"] + 0.4)
    assert found["setpoints"]["each"][0]["at_s"] == pytest.approx(
        first_row["setpoints"]["each"][0]["at_s"] + 0.4
    )
    assert found["duration_s"] == first_row["duration_s"]


def scenario(run: RunData, step: str, at_s: float) -> RunData:
    """Return the run as a smoke flight that passed, with one step."""
    place = {"file": "a.smoke.yaml", "line": 4, "text": step}
    steps = [{"place": place, "outcome": "passed", "kind": "do", "begun_s": at_s, "done_s": at_s}]
    rule = {"place": {**place, "text": "no process fails"}, "outcome": "passed", "worst": None}
    charge = {
        "place": {**place, "text": "each.battery > 20 %"},
        "outcome": "passed",
        "worst": 51.0,
        "unit": "%",
    }
    told = {"passed": True, "scenario": "loss [one]", "verdict": {"steps": steps, "rules": [rule, charge]}}
    return replace(run, scenario=told)


def test_program_killed_by_the_scenario_is_an_injected_fault(run):
    dead = Event(at_s=8.1, process="program.uav1", before="READY", after="EXITED", reason="killed by SIGKILL")
    stop = Event(at_s=13.0, process="arena", text="SIGTERM: landing, then stopping")
    killed = scenario(replace(run, events=[dead, stop]), "at each.airborne + 5 s: kill program each", 8.0)
    assert texts_of(killed, "fault") == [(8.1, "injected fault: program.uav1 was killed by the scenario")]
    assert texts_of(killed, "arena") == [(13.0, "the scenario has ended: the run is stopped")]


@pytest.mark.parametrize(("step", "level"), [("kill program uav1", "note"), ("hang program uav1", "bad")])
def test_killed_program_is_no_failure_of_a_failed_scenario(run, step, level):
    end = Event(at_s=15.0, process="arena", text="failed: program.uav1: killed by SIGKILL")
    flown = scenario(replace(run, events=[end]), step, 8.0)
    failed = replace(flown, scenario={**flown.scenario, "passed": False})
    found = [h for h in happenings(failed) if h.kind == "arena"]
    assert [h.level for h in found] == [level]
    assert found[0].text.endswith("(by the scenario)") == (level == "note")


@pytest.mark.parametrize("step", ["drain battery uav1 in 30 s", "kill program uav2", "kill router"])
def test_process_that_no_step_has_killed_has_failed(run, step):
    dead = Event(at_s=8.1, process="program.uav1", before="READY", after="EXITED", reason="killed by SIGKILL")
    other = scenario(replace(run, events=[dead]), step, 8.0)
    assert texts_of(other, "process") == [(8.1, "program.uav1 ended: killed by SIGKILL")]


def test_faults_and_landings_of_several_vehicles_name_all_of_them(tmp_path):
    two = read_run(make_run(tmp_path / "two", vehicles=2))
    names = ("uav2", "uav1")
    events = [
        Event(at_s=8.1, process=f"program.{n}", before="READY", after="EXITED", reason="killed by SIGKILL")
        for n in names
    ]
    killed = scenario(replace(two, events=events), "kill program each", 8.0)
    assert verdict(killed, happenings(killed)).causes == (
        "at 8.1 s the programs of uav1 and uav2 were killed by the scenario (injected fault)",
    )
    drained = [
        Event(at_s=8.0, process="world", text=f"fault: the battery drain of {n} is set to 3.33 %/s")
        for n in names
    ]
    asking = [asked(vehicle=n, role="program", request="mode AUTO.LAND") for n in names]
    landed = replace(two, events=[*drained, *asking])
    assert verdict(landed, happenings(landed)).causes == (
        "at 8.0 s the battery drain of uav1 and uav2 was set to 3.33 %/s (injected fault)",
        "at 11.0 s the programs of uav1 and uav2 commanded AUTO.LAND",
    )


def test_page_of_a_scenario_names_it_and_what_it_allows(run):
    from arena.report.run_page import run_page

    outcome = {**run.outcome, "failed": ["program.uav1: killed by SIGKILL"], "exit_code": 1}
    page = run_page(scenario(replace(run, outcome=outcome), "kill program each", 20.0))
    assert "<h1>test: loss [one]" in page and ">51 %<" in page
    assert "no process fails, except those that the scenario allows (program.uav1)" in page
    assert payload_time(page) > 20.0  # the last step is on the time axis


def payload_time(page: str) -> float:
    from report_payload import payload

    return float(payload(page)["options"]["time"][1])


def test_battery_figure_has_the_thresholds_of_the_run(tmp_path):
    from report_payload import payload

    from arena.report.run_page import run_page

    folder = make_run(tmp_path / "run")
    plan = json.loads((folder / "plan.json").read_text())
    own = [{"name": "uav1", "params": {"BAT_LOW_THR": 0.5, "BAT_CRIT_THR": 0.07}}]
    plan["slices"]["world.json"] = {"size_m": [7.0, 4.0, 3.0], "vehicles": own}
    (folder / "plan.json").write_text(json.dumps(plan))
    figure = payload(run_page(read_run(folder)))["figures"]["battery"]
    lines = {t["name"]: t["y"] for t in figure["data"] if t["name"].startswith("BAT_")}
    assert lines == {"BAT_LOW_THR 50 %": [50.0, 50.0], "BAT_CRIT_THR 7 %": [7.0, 7.0]}


@pytest.mark.parametrize("asked_speed", [None, 1.0])
def test_speed_and_lateness_of_the_simulation(run, asked_speed):
    from arena.report import run_times

    outcome = {**run.outcome, "real_time": {"factor": 1.98, "asked": asked_speed}, "duration_s": 11.4}
    outcome["processes"]["world"]["stats"] |= {"sim_time_s": 19.5, "rtf_min": 0.34}
    events = [
        Event(at_s=1.4, process="world", after="READY", unix_s=103.0),
        Event(at_s=2.0, process="recorder", text="uav1: airborne", unix_s=104.0),
        Event(at_s=18.0, process="router", text="uav1: disarmed", unix_s=112.0),
    ]
    started = Event(at_s=float("nan"), process="world", after="STARTING", unix_s=100.0)
    told = replace(run, outcome=outcome, events=[started, *events])
    words = run_times.world_words(told)
    assert ("late by" in words) is (asked_speed is not None)
    assert ("ran 2.00 times as fast as real time from the take-off on" in words) is (asked_speed is None)
    assert "1.98" not in words, "the same speed as in the head of the page"
    assert dict(run_times.facts(told)) == {
        "simulated time": "19.5 s",
        "time of the computer": "11.4 s, of which 3.0 s until all processes were ready",
        **(
            {"speed from the take-off on": "2.00 times real time"}
            if asked_speed is None
            else {"speed of the simulation": "1.98 times real time"}
        ),
    }


def landing_flight(run, *, jump_s: float | None = None, mode: str = "AUTO.LAND"):
    """Return the flight with a landing from row 140 on, which drifts 0.3 m north until the touchdown in row 180.

    jump_s: time before the landing at which the setpoint jumps by 1 m [s].
    """
    flight = run.flights["uav1"]
    rows = np.arange(flight.t.size)
    share = np.clip((rows - 140) / 40.0, 0.0, 1.0)
    down, north = flight.pos[:, 2].copy(), np.where(rows < 90, 0.0, 1.0)
    down[140:180] = -1.0 + 0.9 * share[140:180]
    ref_n = flight.group("pos_ref")[:, 0].copy()
    if jump_s is not None:
        ref_n[(flight.t > flight.t[140] - jump_s) & (rows < 140)] += 1.0
    numbers = {**flight.numbers, "truth.pos.down": down, "truth.pos.north": north + 0.3 * share}
    numbers["pos_ref.north"] = ref_n
    modes = tuple("OFFBOARD" if k < 140 else mode for k in rows)
    return replace(flight, numbers=numbers, mode=modes)


def test_drift_while_landing_is_that_from_the_landing_mode_to_the_touchdown(run):
    found = analyse(landing_flight(run), disarmed=True)["landing"]
    assert found["drift_m"] == pytest.approx(0.3, abs=0.01)
    assert found["touchdown_s"] - found["begun_s"] == pytest.approx(40 / 30, abs=0.05)
    assert found["error_m"] == pytest.approx(0.3, abs=0.01), "the last setpoint was held for 1.6 s"


@pytest.mark.parametrize("jump_s", [0.04, 0.16, 1.0])
def test_landing_has_no_distance_to_a_setpoint_that_jumped_before(run, jump_s):
    found = analyse(landing_flight(run, jump_s=jump_s), disarmed=True)["landing"]
    assert found["error_m"] is None and found["drift_m"] == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("rows", [1, 5, 29])
@pytest.mark.parametrize("down", [np.nan, -0.9], ids=["built-in", "PX4"])
def test_reference_of_the_landing_that_comes_before_its_mode_is_no_jump(run, rows, down):
    flight = landing_flight(run)
    ref = {f"pos_ref.{axis}": flight.numbers[f"pos_ref.{axis}"].copy() for axis in ("north", "down")}
    ref["pos_ref.north"][140:] += np.linspace(0.005, 0.0, flight.t.size - 140)
    ref["pos_ref.down"][140:] = down * np.linspace(1.0, 0.5, flight.t.size - 140)
    modes = tuple("OFFBOARD" if k < 140 + rows else "AUTO.LAND" for k in range(flight.t.size))
    found = analyse(replace(flight, numbers={**flight.numbers, **ref}, mode=modes), disarmed=True)["landing"]
    assert found["error_m"] == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("mode", ["OFFBOARD", "AUTO.RTL"])
def test_flight_down_in_another_mode_has_no_drift_while_landing(run, mode):
    assert analyse(landing_flight(run, mode=mode), disarmed=True)["landing"]["drift_m"] is None


def test_estimate_error_counts_in_the_air_only(run):
    flight = run.flights["uav1"]
    north = flight.numbers["ekf.pos.north"].copy()
    north[185:] += 5.0  # on the floor, while the motors still run
    assert flight.armed[200] and not in_air(flight)[200]
    wrong = replace(flight, numbers={**flight.numbers, "ekf.pos.north": north})
    assert estimator(wrong)["pos_max_m"] == estimator(flight)["pos_max_m"] < 0.1
    assert np.nanmax(norm(estimate_error(wrong))) < 0.1


def climbing(run, speed_m_s: float):
    """Return the flight with a climb that has not ended when the first held setpoint ends in row 89."""
    flight = run.flights["uav1"]
    down = flight.pos[:, 2].copy()
    below = (89 - np.arange(90)) / 30.0 * speed_m_s + 0.5
    down[:90] = np.minimum(-0.05, -1.0 + below)
    return replace(flight, numbers={**flight.numbers, "truth.pos.down": down})


def test_unfinished_climb_is_no_error_at_a_held_setpoint(run):
    found = analyse(climbing(run, 0.5))["setpoints"]
    assert [e["settled"] for e in found["each"]] == [False, True]
    assert found["each"][0]["error_m"] > 0.4 and found["worst_m"] == pytest.approx(0.05, abs=1e-3)


def test_vehicle_that_rests_beside_its_setpoint_has_an_error(run):
    found = analyse(climbing(run, 0.1))["setpoints"]
    assert found["each"][0]["settled"] and found["worst_m"] > 0.4


def test_spans_of_held_setpoints_are_searched_once(run, monkeypatch):
    calls, found = [], analysis.constant_spans
    monkeypatch.setattr(analysis, "constant_spans", lambda flight: calls.append(1) or found(flight))
    analyse(run.flights["uav1"])
    assert len(calls) == 1
