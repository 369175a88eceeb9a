"""Texts and tables of the page."""

from __future__ import annotations

import re

import numpy as np
from fleets import fleet, snapshot

from arena.live_view import Event, ProcessRow
from arena.monitor import tables
from arena.monitor.colours import css, trail
from arena.monitor.commands import Command


def test_label_names_vehicle_kind_mode_and_battery():
    assert tables.label(fleet(1), 0) == "uav1 (simulated)\nOFFBOARD, 90 %"


def test_label_warns_of_old_poses_silence_and_disarmed_vehicles():
    old = fleet(1, pose_age_s=np.array([0.9]), silent_s=np.array([4.0]), armed=(False,), kinds=("real",))
    assert tables.label(old, 0) == "uav1 (real)\nOFFBOARD, disarmed, 90 %, pose 0.9 s old, silent for 4 s"
    unknown = fleet(1, modes=("",), battery=np.array([np.nan]))
    assert tables.label(unknown, 0) == "uav1 (simulated)\nno heartbeat"


def test_status_says_why_there_is_no_arena():
    assert "Start one with" in tables.status_html(None, "no arena is running. Start one with `arena up`")
    assert "supervisor does not reply" in tables.status_html(snapshot(answers=False), "")
    assert "lab" in tables.status_html(snapshot(), "") and "2 of 2 armed" in tables.status_html(
        snapshot(), ""
    )


def test_vehicles_table_has_unknown_values_as_dashes():
    html = tables.vehicles_html(fleet(1, p_n=np.full((1, 3), np.nan), battery=np.array([np.nan])))
    assert html.count(">-<") == 2 and "1.00 m" in tables.vehicles_html(fleet(1))


def test_each_vehicle_has_a_dot_in_the_colour_of_its_path():
    html = tables.vehicles_html(fleet(3))
    dots = re.findall(r'color:(#\w+)" title="colour of its flown path"', html)
    assert dots == [css(trail(i)) for i in range(3)] and len(set(dots)) == 3


def test_control_of_another_than_the_program_is_shown():
    assert "land-all" in tables.vehicles_html(fleet(1, controls=("land-all",)))
    assert "program" not in tables.vehicles_html(fleet(1))


def test_texts_from_outside_are_escaped():
    evil = "<img src=x onerror=alert(1)>"
    event = Event(number=0, time_s=1.0, source=evil, text=evil, detail=False)
    process = ProcessRow(
        name=evil, kind="tool", state=evil, reason="", cpu=0.0, memory_mb=0.0, restarts=0, member_of=evil
    )
    command = Command(action="land", vehicles=(evil,), began=0.0, lines=[f"{evil}: {evil}"])
    for html in (
        tables.events_html([event], details=False),
        tables.processes_html([process]),
        tables.commands_html([command]),
        tables.vehicles_html(fleet(1, names=(evil,), modes=(evil,), controls=(evil,))),
        tables.status_html(None, evil),
    ):
        assert "<img" not in html and "&lt;img" in html


def test_details_are_shown_only_on_request():
    events = [Event(number=i, time_s=None, source="router", text="ready", detail=True) for i in range(3)]
    assert "no events yet" in tables.events_html(events, details=False)
    assert tables.events_html(events, details=True).count("ready") == 3


def test_confirmation_of_each_vehicle_is_shown():
    lines = ["uav1: landed and disarmed after 4.2 s", "uav2: NOT CONFIRMED: armed, OFFBOARD"]
    html = tables.commands_html(
        [Command(action="land", vehicles=("uav1", "uav2"), began=0.0, lines=lines, exit_code=1)]
    )
    assert "uav1: landed and disarmed after 4.2 s" in html
    assert "uav2: not confirmed: armed, OFFBOARD" in html
