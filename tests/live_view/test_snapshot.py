"""Events and processes of a snapshot."""

import json

from arena.live_view.snapshot import (
    MAX_EVENTS,
    EventList,
    Playback,
    ShownTime,
    playback_of,
    process_rows,
    real_time_factor,
)


def line(**entry):
    return json.dumps(entry).encode()


def test_event_about_a_vehicle_has_the_vehicle_as_source():
    events = EventList(["uav1"])
    events.on_lines(
        [
            line(mono=1.0, time_s=0.5, process="router", event="uav1: pilot has control: POSCTL"),
            line(mono=1.0, process="mocap", event="no frames"),
        ]
    )
    first, second = events.newest
    assert (first.source, first.text, first.time_s) == ("uav1", "pilot has control: POSCTL", 0.5)
    assert (second.source, second.text, second.time_s) == ("mocap", "no frames", None)


def test_start_of_a_process_is_a_detail_and_its_failure_is_not():
    events = EventList([])
    events.on_lines(
        [
            line(mono=1, process="router", **{"from": "STARTING"}, to="READY", reason="reported ready"),
            line(mono=2, process="router", **{"from": "READY"}, to="FATAL", reason="exit 1"),
        ]
    )
    assert [(e.text, e.detail) for e in events.newest] == [("ready", True), ("failed (exit 1)", False)]


def test_requests_of_the_audit_and_broken_lines_are_left_out():
    events = EventList([])
    events.on_lines([line(mono=1, process="router", audit={}), b"{", b"", b"[]", line(to="x")])
    assert events.newest == ()


def test_changes_of_facts_are_events_but_the_first_facts_are_not():
    events = EventList(["uav1"])
    events.on_status({"facts": {"uav1.armed": False, "uav1.landed": True}, "time_s": 1.0})
    assert events.newest == ()
    facts = {"uav1.armed": True, "uav1.landed": True, "uav1.mode": "OFFBOARD"}
    events.on_status({"facts": facts, "time_s": 2.0})
    (event,) = events.newest
    assert (event.source, event.text, event.time_s) == ("uav1", "armed, OFFBOARD", 2.0)


def test_old_events_are_dropped_and_numbers_continue():
    events = EventList([])
    events.on_lines(line(mono=1, process="a", event=str(i)) for i in range(MAX_EVENTS + 5))
    assert len(events.newest) == MAX_EVENTS
    assert events.newest[-1].number == MAX_EVENTS + 4


def test_process_rows_hold_what_arena_ps_shows():
    world = {
        "kind": "world",
        "state": "READY",
        "reason": "",
        "cpu_now": 0.5,
        "rss_mb": 80.0,
        "restarts": 1,
        "stats": {"rtf": 0.99},
    }
    member = {**world, "kind": "router", "member_of": "world", "stats": {}}
    status = {"processes": {"world": world, "router": member}}
    first, second = process_rows(status)
    assert (first.name, first.state, first.cpu, first.restarts) == ("world", "READY", 0.5, 1)
    assert second.member_of == "world"
    assert real_time_factor(status) == 0.99 and real_time_factor({}) is None


def test_position_in_the_record_is_that_of_the_replay():
    stats = {"time_s": 3.5, "duration_s": 40.0, "paused": True, "rtf": 0.0}
    status = {"processes": {"replay": {"kind": "replay", "stats": stats}}}
    assert playback_of(status) == Playback(time_s=3.5, duration_s=40.0, paused=True)
    assert playback_of({"processes": {"world": {"kind": "world", "stats": {}}}}) is None
    assert playback_of({}) is None


def test_shown_time_stands_while_a_replay_is_paused_or_at_its_end():
    shown = ShownTime()

    def update(now, time_s, *, paused=False):
        shown.update(now, Playback(time_s=time_s, duration_s=9.0, paused=paused))
        return shown.at(now)

    shown.update(100.0, None)
    assert shown.at(100.5) == 100.5
    assert update(101.0, 1.0) == 101.0
    assert update(102.0, 2.0, paused=True) == 101.0
    assert update(112.0, 2.0, paused=True) == 101.0
    assert update(113.0, 3.0) == 102.0
    shown.receive(113.5)
    assert shown.at(113.5) == 102.5
    assert update(114.0, 9.0) == 102.5, "the time stops at the newest message"
