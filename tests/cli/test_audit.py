"""`arena audit`: the requests to the vehicles of a run, in the order of time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arena.cli.audit import entries, line_of
from arena.errors import InputError

REQUEST = {
    "vehicle": "uav1",
    "role": "program",
    "sender": "1/191",
    "from": "127.0.0.1:16001",
    "request": "arm",
    "refused": "",
}


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "plan.json").write_text(json.dumps({"vehicles": [{"name": "uav1"}]}))
    lines = [
        {
            "t": "2026-11-22T04:00:00.000+00:00",
            "mono": 1.0,
            "process": "router",
            "time_s": 2.5,
            "audit": REQUEST,
        },
        {
            "t": "2026-11-22T04:00:03.000+00:00",
            "mono": 4.0,
            "process": "link.uav1",
            "event": "uav1: pilot has control: POSCTL",
        },
        {"t": "2026-11-22T04:00:04.000+00:00", "mono": 5.0, "process": "router", "event": "uav1: in the air"},
        {
            "mono": 6.0,
            "process": "router",
            "time_s": 7.5,
            "audit": {**REQUEST, "refused": "pilot has control"},
        },
    ]
    (tmp_path / "events.jsonl").write_text("\n".join(map(json.dumps, lines)) + '\n{"half')
    (tmp_path / "emergency.jsonl").write_text(
        '{"half\n' + json.dumps({"mono": 4.5, "command": "land-all", "vehicles": ["uav1"]}) + "\n\n"
    )
    return tmp_path


def test_requests_and_changes_of_control_are_in_the_order_of_time(run):
    assert [line_of(entry).strip() for entry in entries(run)] == [
        "2.5 s  uav1: arm by program 1/191 from 127.0.0.1:16001: sent on",
        "04:00:03.0  uav1: pilot has control: POSCTL",
        "uav1: `arena land-all` was started",
        "7.5 s  uav1: arm by program 1/191 from 127.0.0.1:16001: REFUSED: pilot has control",
    ]


def test_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"not a run folder, because it has no plan\.json"):
        entries(tmp_path)


@pytest.mark.parametrize(
    "line",
    [
        '{"mono": 1%s, "command": "land-all", "vehicles": ["uav1"]}' % ("0" * 400),
        '{"mono": "1", "command": "land-all", "vehicles": ["uav1"]}',
        '{"mono": 1.0, "command": "land-all", "vehicles": 1}',
        "[" * 100_000,
    ],
    ids=["huge", "text", "vehicles", "deep"],
)
def test_malformed_line_is_skipped(run, line):
    before = entries(run)
    with (run / "emergency.jsonl").open("a") as file:
        file.write(f"{line}\n")
    assert entries(run) == before
