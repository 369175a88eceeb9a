"""Reading the log of a running arena."""

from __future__ import annotations

import json
from pathlib import Path

from arena.smoke.flying.run_log import RunLog, Tail


def test_tail_returns_complete_lines_once(tmp_path: Path):
    tail, file = Tail(tmp_path / "x"), tmp_path / "x"
    assert tail.lines() == []
    file.write_text("one\ntw")
    assert tail.lines() == ["one"]
    file.write_text("one\ntwo\n")
    assert tail.lines() == ["two"] and tail.lines() == []


def test_states_events_and_crashes_are_read_from_both_logs(
    tmp_path: Path,
):
    (tmp_path / "logs").mkdir()
    run_log = RunLog(tmp_path, ["world", "router"])
    assert not run_log.started
    lines = [
        {"process": "world", "from": "STOPPED", "to": "READY", "reason": "it says so"},
        {"process": "router", "from": "STARTING", "to": "FATAL", "reason": "exit 1"},
        {"process": "world", "event": "uav1 crashed: touched a wall at 3.20 s"},
    ]
    (tmp_path / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines) + '{"half')
    (tmp_path / "logs" / "world.log").write_text("uav2 crashed: tilted 90 degrees at 4.00 s\nat 4.0 s: x\n")
    events = run_log.read()
    assert events == [
        "world: READY: it says so",
        "router: FATAL: exit 1",
        "world: uav1 crashed: touched a wall at 3.20 s",
    ]
    assert run_log.started and run_log.states == {"world": "READY", "router": "FATAL"}
    assert run_log.crashed == {"uav1": "touched a wall at 3.20 s", "uav2": "tilted 90 degrees at 4.00 s"}
