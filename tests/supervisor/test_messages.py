"""The lines that a run shows to a person."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arena.background_writer import BackgroundWriter
from arena.supervisor.event_log import EventLog
from arena.supervisor.messages import Level, Message, VehicleChanges, transition_level, transition_text
from arena.supervisor.process_state import State
from arena.supervisor.terminal import JsonLines, Lines


def lines(*packets: dict[str, object]) -> list[str]:
    changes = VehicleChanges()
    return [str(message) for packet in packets for message in changes.on_facts(packet)]


def test_message_has_time_source_and_text() -> None:
    assert (
        str(Message(text="armed, OFFBOARD", source="uav1", time_s=12.44)) == "  12.4 s  uav1: armed, OFFBOARD"
    )
    assert str(Message(text="12 processes ready in 5.1 s")) == "12 processes ready in 5.1 s"


def test_armed_mode_and_ground_contact_are_one_line_each() -> None:
    first = {"uav1.armed": False, "uav1.mode": "AUTO.LOITER", "uav1.landed": True}
    assert lines(
        first,
        {"uav1.mode": "OFFBOARD", "uav1.armed": True},
        {"uav1.landed": False},
        {"uav1.mode": "AUTO.LAND"},
        {"uav1.landed": True},
        {"uav1.armed": False},
    ) == [
        "uav1: armed, OFFBOARD",
        "uav1: in the air (land detector)",
        "uav1: mode AUTO.LAND",
        "uav1: on the ground (land detector)",
        "uav1: disarmed",
    ]


def test_mode_of_a_disarmed_vehicle_and_repeated_facts_show_nothing() -> None:
    assert lines({"uav1.armed": False}, {"uav1.mode": "POSCTL"}, {"uav1.mode": "OFFBOARD"}) == []
    assert lines({"uav1.armed": True}, {"uav1.armed": True}) == ["uav1: armed, mode unknown"]


def test_lost_heartbeat_is_shown_per_vehicle() -> None:
    found = lines(
        {"uav1.connected": True, "uav2.connected": True}, {"uav2.connected": False}, {"uav2.connected": True}
    )
    assert found == ["uav2: no heartbeat for 3 s", "uav2: heartbeat received again"]


@pytest.mark.parametrize(
    ("state", "kind", "starts", "ending", "level"),
    [
        (State.STARTING, "router", 1, False, Level.DETAIL),
        (State.READY, "router", 1, False, Level.DETAIL),
        (State.READY, "router", 2, False, Level.CHANGE),
        (State.BACKOFF, "router", 1, False, Level.CHANGE),
        (State.EXITED, "program", 1, False, Level.CHANGE),
        (State.EXITED, "router", 1, True, Level.DETAIL),
        (State.STOPPING, "router", 1, True, Level.DETAIL),
        (State.FATAL, "router", 3, True, Level.RESULT),
    ],
)
def test_level_of_a_change_of_state(state: State, kind: str, starts: int, ending: bool, level: Level) -> None:
    assert transition_level(state, kind=kind, starts=starts, ending=ending) is level


def test_a_reason_is_shown_only_if_it_adds_something() -> None:
    assert transition_text(State.READY, "reported ready") == "ready"
    assert transition_text(State.EXITED, "exit 1") == "ended (exit 1)"


def test_event_about_a_vehicle_is_shown_under_its_name(tmp_path: Path) -> None:
    shown: list[Message] = []
    writer = BackgroundWriter("files", limit=100)
    log = EventLog(tmp_path / "events.jsonl", shown.append, writer, vehicles=["uav1"], time_s=lambda: 31.04)
    log.event(5.0, "router", "uav1: Failsafe activated: no offboard setpoints: AUTO.LAND")
    log.event(5.0, "logger.uav1", "uav1: airborne")
    log.event(5.0, "router", "uav2 is unknown")
    log.close()
    assert writer.flush(60.0)
    assert str(shown[0]) == "  31.0 s  uav1: Failsafe activated: no offboard setpoints: AUTO.LAND"
    assert shown[1].level is Level.DETAIL, "the facts of the router show it already"
    assert shown[2].source == "router"
    (first, *_) = map(json.loads, (tmp_path / "events.jsonl").read_text().splitlines())
    assert (
        first["process"] == "router"
        and first["time_s"] == 31.04
        and first["event"].startswith("uav1: Failsafe")
    )


def test_times_in_the_file_never_decrease(tmp_path: Path) -> None:
    writer = BackgroundWriter("files", limit=100)
    log = EventLog(tmp_path / "events.jsonl", lambda message: None, writer)
    log.event(5.3, "router", "received within the round that began at 5.0")
    log.transition(5.0, "mocap", State.STARTING, State.READY, "reported ready", level=Level.DETAIL)
    log.audit(5.2, "router", {"request": "arm"})
    log.event(5.4, "router", "later")
    log.close()
    assert writer.flush(60.0)
    found = [json.loads(line)["mono"] for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    assert found == [5.3, 5.3, 5.3, 5.4]


def test_lines_below_the_level_are_not_shown(capsys: pytest.CaptureFixture[str]) -> None:
    for level in Level:
        quiet, normal = Lines(Level.RESULT), Lines()
        quiet.say(Message(text=f"quiet {level}", level=level))
        quiet.flush()
        normal.say(Message(text=f"normal {level}", level=level))
        normal.flush()
    assert capsys.readouterr().out.splitlines() == ["normal 1", "quiet 2", "normal 2"]


def test_json_lines_are_one_object_per_line(capsys: pytest.CaptureFixture[str]) -> None:
    show = JsonLines()
    show.say(Message(text="armed, OFFBOARD", source="uav1", time_s=2.0))
    show.say(Message(text="ready", source="router", level=Level.DETAIL))
    show.flush()
    assert [json.loads(line) for line in capsys.readouterr().out.splitlines()] == [
        {"time_s": 2.0, "source": "uav1", "level": "change", "text": "armed, OFFBOARD"}
    ]
