"""The cause of a lost vehicle: failsafe, land-all, the arena's end, the copilot, a pilot."""

from __future__ import annotations

import dataclasses
import json
import threading
import time

import pytest
from served import until

from arena.emergency.run_record import record_command
from arena.errors import OffboardLostError
from arena.uav.loss_cause import UNKNOWN, cause_of_loss

from .conftest import make_uav

NOW = 1000.0


def write_event(run, process: str, event: str, mono: float = NOW - 1.0) -> None:
    with (run / "events.jsonl").open("a") as file:
        file.write(json.dumps({"t": "x", "mono": mono, "process": process, "event": event}) + "\n{broken\n")


def test_failsafe_is_named_with_the_autopilots_text(tmp_path):
    texts = ["Takeoff detected", "Failsafe activated: offboard control lost: AUTO.LAND"]
    assert cause_of_loss("uav1", texts, tmp_path, NOW) == f"failsafe of the autopilot ({texts[1]})"


def test_stopping_arena_is_named(tmp_path):
    write_event(tmp_path, "arena", "Ctrl-C: landing, then stopping")
    assert cause_of_loss("uav1", [], tmp_path, NOW) == "the arena is stopping and lands its vehicles (Ctrl-C)"


def test_copilot_is_named_for_its_own_vehicle_only(tmp_path):
    write_event(tmp_path, "copilot", "uav1: closer than 0.5 m to uav2: hold")
    assert "the copilot commanded it (closer than" in cause_of_loss("uav1", [], tmp_path, NOW)
    assert cause_of_loss("uav2", [], tmp_path, NOW) == UNKNOWN


def test_land_all_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("time.monotonic", lambda: NOW - 0.5)
    record_command(tmp_path, "land-all", ["uav1"])
    assert cause_of_loss("uav1", [], tmp_path, NOW) == "arena land-all commanded it"
    assert cause_of_loss("uav2", [], tmp_path, NOW) == UNKNOWN


def test_pilot_who_uses_the_sticks_is_named():
    texts = ["Pilot took over using sticks"]
    assert cause_of_loss("uav1", texts, None, NOW) == "a pilot (Pilot took over using sticks)"


@pytest.mark.parametrize(
    ("process", "event", "cause"),
    [
        ("link.uav1", "pilot has control: POSCTL", "a pilot has taken control (POSCTL)"),
        ("router", "ground station has control: AUTO.LOITER commanded", "a ground station has taken control"),
        (
            "router",
            "land-all has control: landing, until `arena release`",
            "arena land-all has taken control",
        ),
    ],
)
def test_holder_of_the_authority_is_named(tmp_path, process, event, cause):  # review fault 5
    write_event(tmp_path, process, f"uav1: {event}")
    write_event(tmp_path, process, "uav1: arm requested by program refused: pilot has control")
    assert cause_of_loss("uav1", [], tmp_path, NOW).startswith(cause)
    assert cause_of_loss("uav2", [], tmp_path, NOW) == UNKNOWN


def test_copilot_in_a_text_is_not_a_pilot():
    assert cause_of_loss("uav1", ["copilot holds the vehicle"], None, NOW) == UNKNOWN


def test_old_records_and_unreadable_folders_are_ignored(tmp_path):
    write_event(tmp_path, "arena", "Ctrl-C: landing, then stopping", mono=NOW - 60.0)
    assert cause_of_loss("uav1", [], tmp_path, NOW) == UNKNOWN
    assert cause_of_loss("uav1", [], tmp_path / "missing", NOW) == UNKNOWN


@pytest.mark.parametrize(
    "line",
    [
        '{"mono": 1%s, "vehicles": ["uav1"]}' % ("0" * 400),
        f'{{"mono": {NOW}, "vehicles": 1}}',
        "[" * 100_000,
    ],
    ids=["huge", "vehicles", "deep"],
)
def test_malformed_line_is_skipped(tmp_path, line):
    (tmp_path / "emergency.jsonl").write_text(f"{line}\n")
    assert cause_of_loss("uav1", [], tmp_path, NOW) == UNKNOWN


def test_exception_names_land_all_and_not_a_pilot(autopilot, address, tmp_path):
    with make_uav(address, run=str(tmp_path)) as uav:
        until(lambda: uav.ekf.age_s < 0.5 and uav.info.is_connected)
        uav.start_offboard_mission()
        record_command(tmp_path, "land-all", ["uav1"])
        autopilot.mode = "AUTO.LAND"
        with pytest.raises(OffboardLostError, match=r"is now in AUTO\.LAND: arena land-all commanded it\."):
            uav.set_pos_yaw([0, 0, -1], 0.0, 60.0)


def test_exception_names_the_pilot_whom_the_router_reports_later(autopilot, address, tmp_path):
    with make_uav(address, run=str(tmp_path)) as uav:
        until(lambda: uav.ekf.age_s < 0.5 and uav.info.is_connected)
        uav.start_offboard_mission()
        autopilot.mode = "POSCTL"
        record = lambda: write_event(  # noqa: E731
            tmp_path, "link.uav1", "uav1: pilot has control: POSCTL", time.monotonic()
        )
        uav._source.telemetry.heartbeat = dataclasses.replace(uav._source.telemetry.heartbeat, mode="POSCTL")
        uav.control._record_wait_s = 60.0  # the machine may be busy
        threading.Timer(0.1, record).start()
        with pytest.raises(OffboardLostError, match=r"POSCTL: a pilot has taken control \(POSCTL\)\."):
            uav.set_pos_yaw([0, 0, -1], 0.0, 60.0)
