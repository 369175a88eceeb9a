"""The report of a replay: what was replayed, and the events of the recorded flight."""

from __future__ import annotations

import json

from record_files import RecordFile

from arena.report.happenings import happenings
from arena.report.run_data import read_run
from arena.report.verdict import verdict


def replayed(folder, clock="simulation"):
    folder.mkdir()
    record = RecordFile(folder / "flight.mcap", clock=clock)
    fields = {
        "t": "2026-11-22T14:00:00+00:00",
        "time_s": 4.0,
        "process": "router",
        "event": "uav1: Failsafe activated: geofence: AUTO.LAND",
    }
    record.channels.on_event(json.dumps(fields).encode(), fields, 4.0)
    record.close()
    plan = {
        "name": "lab-replay",
        "replay": "/runs/20261122-lab/flight.mcap",
        "vehicles": [{"name": "uav1", "simulated": True}],
    }
    (folder / "plan.json").write_text(json.dumps(plan))
    own = [
        {
            "process": "replay",
            "event": "recorded: router: uav1: Failsafe activated: geofence: AUTO.LAND",
            "time_s": 4.0,
        },
        {"process": "replay", "event": "uav1: refused: arm from system 255, component 190", "time_s": 5.0},
        {"process": "router", "from": "STARTING", "to": "READY", "reason": "reported ready", "time_s": 0.1},
    ]
    (folder / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in own))
    return read_run(folder)


def test_events_are_those_of_the_flight_and_the_refused_commands(tmp_path):
    run = replayed(tmp_path / "replay")
    assert [(e.at_s, e.process, e.text.partition(":")[2].split()[0]) for e in run.events] == [
        (4.0, "router", "Failsafe"),
        (5.0, "replay", "refused:"),
    ]


def test_verdict_begins_with_what_was_replayed(tmp_path):
    run = replayed(tmp_path / "replay")
    assert verdict(run, happenings(run)).text.startswith("Replay of the flight 20261122-lab: ")
