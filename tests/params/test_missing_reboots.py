"""Tests of the record of missing reboots."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.errors import InputError
from arena.params.transfer.missing_reboots import MissingReboots, autopilot_key


def test_missing_reboot_ends_with_a_later_boot_of_the_same_autopilot(tmp_path: Path) -> None:
    missing = MissingReboots.read(tmp_path)
    missing.add("aa", "uav1", ["SYS_A"], 100.0)
    missing.add("bb", "uav2", ["SYS_A"], 100.0)
    missing.save()
    again = MissingReboots.read(tmp_path)
    assert again.autopilots == missing.autopilots
    for booted_at in (None, 50.0, 100.0):
        again.remove_if_booted("aa", booted_at)
    assert set(again.autopilots) == {"aa", "bb"}
    again.remove_if_booted("aa", 101.0)
    again.remove_if_booted("cc", 101.0)
    again.save()
    assert set(MissingReboots.read(tmp_path).autopilots) == {"bb"}


def test_later_write_needs_a_later_boot(tmp_path: Path) -> None:
    missing = MissingReboots.read(tmp_path)
    missing.add("aa", "uav1", ["SYS_A", "SYS_B"], 100.0)
    missing.add("aa", "uav1", ["SYS_B", "SYS_C"], 200.0)
    assert missing.autopilots["aa"].parameters == ("SYS_A", "SYS_B", "SYS_C")
    missing.remove_if_booted("aa", 150.0)
    assert missing.autopilots
    missing.remove("aa")
    missing.save()
    assert not list(tmp_path.iterdir())


def test_autopilot_without_uid_is_known_by_its_address() -> None:
    assert autopilot_key("0102", "id 1, udp") == "0102"
    assert autopilot_key("", "id 1, udp") == autopilot_key("none", "id 1, udp") == "id 1, udp"


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"format": "arena missing reboots 1", "autopilots": {"a": {}}}']
)
def test_file_that_is_no_record_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "missing_reboots.json").write_text(text)
    with pytest.raises(InputError, match="Reboot all vehicles and delete the file"):
        MissingReboots.read(tmp_path)
