"""Identity and axes check behind the link: a vehicle without a valid record does not arm. review fault 2"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from carried import axes
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.arm_permit import ArmPermit
from arena.fcu_link.axes_record import AxesRecord, BootTime, RecordFile
from arena.mocap.client import CapturedFrame

from .carried_rig import COMMAND, COMPUTER, DATE, STANDING, Captured, CarriedRig, Motion
from .link_rig import UID, Rig, arm, heartbeat

NEEDED = "no axes check: run arena preflight uav7"


def reasons(rig: Rig) -> str:
    return "; ".join(rig.reasons())


def moving(begin_s: float, **keys: Any) -> Motion:
    """Return a motion that begins some time after the start of the rig's clock."""
    return Motion(begin=100.0 + begin_s, **keys)


def checked(**keys: Any) -> tuple[CarriedRig, dict[str, Any]]:
    """Return a rig whose vehicle was carried through a check, and the status of the check."""
    rig = CarriedRig(keys.pop("motion", moving(7.0)), **keys)
    rig.carry(4.0)
    rig.start()
    return rig, rig.until_checked()


@pytest.fixture(scope="module")
def passed() -> tuple[CarriedRig, dict[str, Any]]:
    """Return a vehicle that has passed its check, and the status of the check. Its poses arrive 45 ms after the motion."""
    return checked(late_s=0.045)


@pytest.fixture(scope="module")
def record(passed: tuple[CarriedRig, dict[str, Any]]) -> AxesRecord:
    found = passed[0].core.axes.record
    assert found is not None
    return found


def test_a_vehicle_arms_only_after_its_check():
    rig = CarriedRig(moving(7.0), others={"uav2": Captured(moves=STANDING)})
    rig.carry(4.0)
    assert rig.reasons() == [f"Preflight: {NEEDED}"]
    rig.send("router", arm())
    assert not rig.arming_passed()
    rig.start()
    rig.carry(1.0)
    assert rig.reasons() == ["Preflight: the axes check is running"]
    status = rig.until_checked()
    assert status["state"] == "passed", status
    assert rig.reasons() == []
    rig.send("router", arm())
    assert rig.arming_passed()
    record = rig.core.axes.record
    assert record is not None and record.turned_deg < 3.0 and record.correlation > 0.95
    assert (record.uid, record.body, record.definition) == (UID.hex(), "uav7", "markers 1")
    assert (record.by, record.when, record.boot) == (
        "eva",
        DATE,
        BootTime(computer=COMPUTER, at_s=pytest.approx(40.0, abs=0.1)),
    )


def test_a_permit_given_during_the_check_does_not_arm_after_it():
    rig = CarriedRig(moving(7.0))
    rig.core.permit = ArmPermit("uav7", needed=True)
    rig.carry(4.0)
    rig.start()
    while rig.core.axes.running:
        rig.core.on_request({"do": "permit", "vehicle": "uav7", "by": "eva"}, rig.now)
        rig.carry(0.1)
    assert rig.until_checked()["state"] == "passed"  # the person still holds the vehicle
    rig.send("router", arm())
    assert not rig.arming_passed()
    assert any("no arm permit from eva: the axes check is running" in text for text in rig.core.events())
    rig.core.on_request({"do": "permit", "vehicle": "uav7", "by": "eva"}, rig.now)
    rig.send("router", arm())
    assert rig.arming_passed()


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"axes": (0.0, 0.0, 90.0)}, "turned by 90 deg about the vertical axis"),
        ({"axes": (60.0, 0.0, 0.0)}, "rolled by 60 deg"),
        ({"exchanged": True}, "the body 'uav2' moved with it: they are exchanged"),
    ],
)
def test_a_wrong_body_does_not_arm(body, words):
    motion = moving(7.0)
    if "axes" in body:
        own, others = Captured(moves=motion, axes=axes(*body["axes"])), {}
    else:
        own, others = Captured(moves=STANDING), {"uav2": Captured(moves=motion)}
    rig, status = checked(motion=motion, body=own, others=others, imu=False)
    assert status["state"] == "failed" and words in status["lines"][0], status
    assert NEEDED in reasons(rig)
    rig.send("router", arm())
    assert not rig.arming_passed()


def test_a_failed_check_ends_an_earlier_record(record):
    rig = CarriedRig(moving(7.0), body=Captured(moves=STANDING), record=record)
    rig.carry(4.0)
    rig.start()
    rig.until_checked()
    assert rig.core.axes.record is None


def test_a_check_that_was_not_carried_out_keeps_the_record(record):
    rig = CarriedRig(STANDING, record=record)
    rig.carry(4.0)
    rig.start()
    rig.core.on_request({"do": "stop_axes_check", "vehicle": "uav7", "by": "eva"}, rig.now)
    assert rig.core.axes.status["lines"] == ["stopped by eva"] and rig.reasons() == []


def test_a_refused_check_does_not_bring_back_the_record_before_a_failed_check(record):
    rig = CarriedRig(moving(7.0), body=Captured(moves=STANDING), record=record)
    rig.carry(4.0)
    rig.start()
    assert rig.core.axes.record is None, "if this process dies in the check, no record remains"
    rig.until_checked()
    refuse_check(rig)
    assert rig.core.axes.record is None


def test_a_refused_check_keeps_the_record_of_a_passed_check():
    rig, status = checked()
    assert status["state"] == "passed" and rig.core.axes.record is not None
    refuse_check(rig)
    assert rig.core.axes.record is not None and rig.reasons() == []


def refuse_check(rig: CarriedRig) -> None:
    rig.core.axes.start("eva", rig.now, "the vehicle is not connected", UID.hex())
    assert rig.core.axes.status["lines"] == ["the vehicle is not connected"]


def test_latency_and_delay_are_measured_and_a_delay_is_proposed(passed):
    rig, status = passed
    lines = "\n".join(status["lines"])
    assert "latency: frames arrive 8 ms after their exposure" in lines
    assert "EKF2_EV_DELAY is 0" in lines and "arena params push uav7" in lines
    proposed = json.loads(
        lines.split("value: ")[1].split(",")[0]
    )  # 45 ms to the link, half of a round trip of 10 ms to the vehicle
    assert proposed == pytest.approx(50, abs=6)
    assert not [m for m in rig.sent("PARAM_SET")]


def test_the_rate_of_the_inertial_sensors_is_raised_for_the_check_only(passed):
    rig, _ = passed
    rig.carry(1.0)
    imu = [hz for msgid, hz in rig.rates if msgid == mavlink.MAVLINK_MSG_ID_HIGHRES_IMU]
    assert imu == [pytest.approx(50.0), pytest.approx(30.0)]


def test_answers_to_the_check_do_not_reach_the_router(passed):
    rig, _ = passed
    assert rig.received("router", "TIMESYNC") == []
    rig.receive(mavlink.MAVLink_timesync_message(0, 5))
    assert len(rig.received("router", "TIMESYNC")) == 1


# -- validity of a record ---------------------------------------------------------------------------------------------------


def standing(record: AxesRecord, **keys: Any) -> CarriedRig:
    rig = CarriedRig(STANDING, record=record, **keys)
    return rig


def test_a_record_is_valid_for_a_new_link_process(record):
    rig = standing(record)
    rig.carry(4.0)
    assert rig.reasons() == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"definition": "markers 2"}, "body changed: run arena preflight uav7"),
        ({"body": "uav8"}, "body changed: run arena preflight uav7"),
        ({"uid": "99"}, "other autopilot: run arena preflight uav7"),
        ({"boot": BootTime(computer=COMPUTER, at_s=46.0)}, "has rebooted: run arena preflight uav7"),
        ({"boot": BootTime(computer="start 2", at_s=40.0)}, "has rebooted: run arena preflight uav7"),
    ],
)
def test_a_record_of_something_else_is_not_valid(record, change, words):
    rig = standing(dataclasses.replace(record, **change))
    rig.carry(4.0)
    assert words in reasons(rig)
    assert all(len(text.encode()) <= 50 for text in rig.reasons())


@pytest.mark.parametrize("drift_s", [-4.0, 4.0])
def test_the_drift_of_the_clocks_does_not_end_a_record(record, drift_s):
    boot = BootTime(computer=COMPUTER, at_s=record.boot.at_s + drift_s)
    rig = standing(dataclasses.replace(record, boot=boot))
    rig.carry(4.0)
    assert rig.reasons() == []


def test_a_reboot_ends_a_record(record):
    rig = standing(record)
    rig.carry(4.0)
    rig.boot_s = rig.now - 1.0
    rig.carry(4.0)
    assert "has rebooted: run arena preflight uav7" in reasons(rig)


def test_time_while_the_computer_slept_counts(record):
    rig = standing(record)
    rig.core.axes.set_time(COMPUTER, 600.0, DATE)
    rig.carry(4.0)
    assert "has rebooted: run arena preflight uav7" in reasons(rig)


def test_a_body_that_is_defined_again_ends_a_record(record):
    rig = standing(record)
    rig.carry(4.0)
    rig.definition = "markers 2"
    rig.carry(1.0)
    assert "body changed: run arena preflight uav7" in reasons(rig)
    assert any("was defined again" in event for event in rig.core.events())


def test_a_body_that_is_defined_again_while_it_was_unknown_stops_the_check():
    rig = CarriedRig(moving(9.0))
    rig.carry(1.0)
    rig.start()
    for definition in ("", "markers 2"):
        rig.carry(1.0)
        rig.definition = definition
    rig.carry(1.0)
    assert rig.core.axes.record is None and not rig.core.axes.running
    assert any("was defined again" in event for event in rig.core.events())


def test_the_definition_of_the_body_must_be_known(record):
    rig = standing(record, definition="")
    rig.carry(4.0)
    assert "definition of its body not received yet" in reasons(rig)
    rig.start()
    assert "has not reported the definition" in rig.core.axes.status["text"]
    rig.carry(11.0)
    assert rig.core.axes.status["lines"] == [
        "the pose forwarder has not reported the definition of the rigid body for 10 s"
    ]


def test_a_check_waits_for_the_definition_of_the_body():
    rig = CarriedRig(moving(9.0), definition="")
    rig.carry(1.0)
    rig.start()
    rig.carry(2.0)
    rig.definition = "markers 1"
    assert rig.until_checked()["state"] == "passed"


def test_a_vehicle_without_the_check_arms():
    rig = CarriedRig(STANDING, axes_check=False)
    rig.carry(4.0)
    assert rig.reasons() == []


# -- when a check runs ------------------------------------------------------------------------------------------------------


def test_an_armed_vehicle_is_not_checked():
    rig = CarriedRig(STANDING)
    rig.armed = True
    rig.carry(4.0)
    rig.start()
    assert rig.core.axes.status["lines"] == ["it is armed: nobody must lift an armed vehicle"]


def test_a_program_cannot_arm_while_somebody_stands_beside_the_vehicle():
    rig = CarriedRig(moving(7.0))
    rig.core.permit = ArmPermit("uav7", needed=True)
    rig.carry(4.0)
    rig.core.on_request({"do": "permit", **COMMAND}, rig.now)
    assert "arm permit" not in reasons(rig)
    rig.start()
    assert rig.until_checked()["state"] == "passed"
    assert rig.reasons() == ["no arm permit: run arena arm-permit uav7"]


def test_arming_by_the_pilot_ends_a_check():
    rig = CarriedRig(STANDING)
    rig.carry(4.0)
    rig.start()
    rig.receive(heartbeat(armed=True))
    assert rig.core.axes.status["lines"] == ["the vehicle was armed"] and not rig.core.axes.running


@pytest.mark.parametrize("what", ["reboot", "new definition"])
def test_a_change_during_the_check_ends_it(what):
    rig = CarriedRig(STANDING)
    rig.carry(4.0)
    rig.start()
    if what == "reboot":
        rig.boot_s = rig.now
    else:
        rig.definition = "markers 2"
    rig.carry(2.0)
    assert rig.core.axes.status["state"] == "failed" and not rig.core.axes.running


def test_without_frames_of_the_room_the_identity_is_not_certain():
    rig = CarriedRig(moving(7.0))
    rig._frame = lambda: CapturedFrame(1, 0.0, (), ())  # type: ignore[method-assign]
    rig.carry(4.0)
    rig.start()
    assert "the other bodies of the room were not compared" in rig.until_checked()["lines"][0]


def test_nothing_is_sent_that_could_move_the_vehicle():
    rig = CarriedRig(moving(7.0))
    rig.carry(4.0)
    sent = []
    flush = rig.flush
    rig.flush = lambda: sent.extend(flush()) or []  # type: ignore[method-assign]
    rig.start()
    rig.until_checked()
    kinds = {(m.get_type(), getattr(m, "command", 0)) for m in sent}
    interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    assert kinds <= {
        ("COMMAND_LONG", interval), ("TIMESYNC", 0), ("PARAM_REQUEST_READ", 0), ("HEARTBEAT", 0), ("ODOMETRY", 0)
    }  # fmt: skip


def test_inertial_data_are_not_decoded_in_flight(monkeypatch):
    rig = CarriedRig(STANDING)
    rig.carry(1.0)
    seen: list[str] = []
    on_message = rig.core._on_message
    monkeypatch.setattr(
        rig.core, "_on_message", lambda m, now: (seen.append(m.get_type()), on_message(m, now))
    )
    rig.carry(1.0)
    assert "HIGHRES_IMU" in seen
    rig.armed = True
    rig.carry(1.0)
    seen.clear()
    rig.carry(1.0)
    assert "HEARTBEAT" in seen and "HIGHRES_IMU" not in seen


# -- the file ---------------------------------------------------------------------------------------------------------------


def test_a_record_is_read_back_from_its_file(record, tmp_path: Path):
    file = RecordFile(str(tmp_path / "preflight" / "uav7.json"))
    assert file.read() is None
    file.write(record)
    assert file.read() == record
    file.write(None)
    assert file.read() is None


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"boot": 1}', '{"boot": {"computer": "x", "at_s": "y"}}'])
def test_a_damaged_file_is_no_record(text, tmp_path: Path):
    (tmp_path / "uav7.json").write_text(text)
    assert RecordFile(str(tmp_path / "uav7.json")).read() is None
