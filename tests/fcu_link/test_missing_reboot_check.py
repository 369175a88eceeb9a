"""A vehicle that still needs the reboot after a parameter push must not be armed."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from arena.clock_reading import boot_id
from arena.fcu_link.axes_record import BootTime
from arena.fcu_link.missing_reboot_check import MissingRebootCheck
from arena.fcu_link.settings import RebootRecord
from arena.missing_reboots import FILE, ClockTime, MissingReboots

from .link_rig import Rig, arm

UID = "0102"
ADDRESS = "id 7, udpin://127.0.0.1:14540"


def check_of(folder: Path) -> MissingRebootCheck:
    return MissingRebootCheck(RebootRecord(folder=str(folder), address=ADDRESS))


def push(folder: Path, *parameters: str, key: str = UID) -> None:
    """Record a push to an autopilot that had run for 100 s."""
    missing = MissingReboots.read(folder)
    missing.add(key, "uav7", parameters, ClockTime.now(), address=ADDRESS, uptime_s=100.0)
    missing.save()


def booted(ago_s: float) -> BootTime:
    return BootTime(computer=boot_id(), at_s=time.clock_gettime(time.CLOCK_BOOTTIME) - ago_s)


def test_without_a_push_nothing_forbids_arming(tmp_path):
    check = check_of(tmp_path)
    assert check.reasons(UID, booted(1e4)) == [] and check.events == []


@pytest.mark.parametrize("boot", [booted(101.0), None], ids=["still running", "boot time unknown"])
def test_a_vehicle_that_has_not_booted_since_the_push_must_not_arm(tmp_path, boot):
    push(tmp_path, "EKF2_EV_CTRL", "SYS_HITL")
    assert check_of(tmp_path).reasons(UID, boot) == ["reboot needed for EKF2_EV_CTRL +1"]


def test_a_vehicle_that_has_booted_since_the_push_may_arm(tmp_path):
    push(tmp_path, "EKF2_EV_CTRL")
    assert check_of(tmp_path).reasons(UID, booted(50.0)) == []


def test_the_missing_reboot_of_another_autopilot_does_not_count(tmp_path):
    push(tmp_path, "EKF2_EV_CTRL", key="0909")
    assert check_of(tmp_path).reasons(UID, None) == []


@pytest.mark.parametrize(("key", "uid"), [(ADDRESS, UID), (UID, ""), (ADDRESS, "")])
def test_an_autopilot_without_a_uid_is_known_by_its_address(tmp_path, key, uid):
    push(tmp_path, "EKF2_EV_CTRL", key=key)
    check = check_of(tmp_path)
    assert check.reasons(uid, booted(101.0)) == ["reboot needed for EKF2_EV_CTRL"]
    assert list(MissingReboots.read(tmp_path).autopilots) == [key], "the file was changed"


def test_the_user_is_told_once(tmp_path):
    push(tmp_path, "EKF2_EV_CTRL", "SYS_HITL")
    check = check_of(tmp_path)
    for _ in range(3):
        check.reasons(UID, booted(101.0))
    assert check.events == ["needs a reboot: a push has written EKF2_EV_CTRL, SYS_HITL"]


def test_a_file_that_cannot_be_read_forbids_arming(tmp_path):
    (tmp_path / FILE).write_text("{")
    check = check_of(tmp_path)
    assert check.reasons(UID, booted(1.0)) == [f"cannot read {FILE}"]
    assert str(tmp_path / FILE) in check.events[0]


def test_an_entry_without_parameters_still_forbids_arming(tmp_path):
    push(tmp_path)
    assert check_of(tmp_path).reasons(UID, booted(101.0)) == ["reboot needed for a push"]


def test_the_link_refuses_to_arm_and_says_why():
    rig = Rig()
    rig.fly(2.0)
    assert rig.reasons() == []
    rig.core.missing_reboot = ["reboot needed for COM_OBL_RC_ACT_LONG +2"]
    rig.send("router", arm())
    assert not rig.arming_passed()
    assert {t.text for t in rig.got["router"] if t.get_type() == "STATUSTEXT"} == {
        "reboot needed for COM_OBL_RC_ACT_LONG +2"
    }
    rig.core.missing_reboot = []
    rig.send("router", arm())
    assert rig.arming_passed()
