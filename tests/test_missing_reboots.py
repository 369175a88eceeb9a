"""Tests of the record of missing reboots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from arena.errors import InputError
from arena.missing_reboots import ClockTime, MissingReboots


def at(unix_s: float, **more: Any) -> ClockTime:
    return ClockTime(unix_s=unix_s, **more)


def test_missing_reboot_ends_with_a_later_boot_of_the_same_autopilot(tmp_path: Path) -> None:
    missing = MissingReboots.read(tmp_path)
    missing.add("aa", "uav1", ["SYS_A"], at(100.0))
    missing.add("bb", "uav2", ["SYS_A"], at(100.0))
    missing.save()
    again = MissingReboots.read(tmp_path)
    assert again.autopilots == missing.autopilots
    for uptime_s in (None, 150.0, 100.0):
        again.remove_if_booted("aa", uptime_s, at(200.0))
    assert set(again.autopilots) == {"aa", "bb"}
    again.remove_if_booted("aa", 99.0, at(200.0))
    again.remove_if_booted("cc", 99.0, at(200.0))
    again.save()
    assert set(MissingReboots.read(tmp_path).autopilots) == {"bb"}


def test_later_write_needs_a_later_boot(tmp_path: Path) -> None:
    missing = MissingReboots.read(tmp_path)
    missing.add("aa", "uav1", ["SYS_A", "SYS_B"], at(100.0))
    missing.add("aa", "uav1", ["SYS_B", "SYS_C"], at(200.0))
    assert missing.autopilots["aa"].parameters == ("SYS_A", "SYS_B", "SYS_C")
    missing.remove_if_booted("aa", 100.0, at(250.0))
    assert missing.autopilots
    missing.remove("aa")
    missing.save()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("jump_s", [86400.0, -86400.0])
@pytest.mark.parametrize(("uptime_s", "booted"), [(60.0, False), (5.0, True)])
def test_clock_jump_changes_no_missing_reboot(
    tmp_path: Path, jump_s: float, uptime_s: float, booted: bool
) -> None:
    missing = MissingReboots.read(tmp_path)
    missing.add("aa", "uav1", ["SYS_A"], at(1e6, boot_id="x", since_boot_s=50.0))
    effective = missing.remove_if_booted(
        "aa", uptime_s, at(1e6 + jump_s + 10.0, boot_id="x", since_boot_s=60.0)
    )
    assert bool(effective) == booted and bool(missing.autopilots) != booted


def test_shorter_time_since_boot_proves_a_boot_without_a_clock(tmp_path: Path) -> None:
    missing = MissingReboots.read(tmp_path)
    missing.add("aa", "uav1", ["SYS_A"], at(1e6), uptime_s=500.0)
    missing.save()
    again = MissingReboots.read(tmp_path)
    assert not again.remove_if_booted("aa", 510.0, at(1e6 - 86400.0))
    assert again.remove_if_booted("aa", 490.0, at(1e6 - 86400.0)) == ("SYS_A",)


def test_clock_time_counts_since_the_boot_of_the_computer() -> None:
    first, second = ClockTime.now(), ClockTime.now()
    assert first.boot_id == second.boot_id != "" and 0 < first.since_boot_s <= second.since_boot_s


def test_autopilot_without_uid_is_known_by_its_address(tmp_path: Path) -> None:
    missing = MissingReboots.read(tmp_path)
    assert missing.key_of("0102", "id 1, udp") == "0102"
    assert missing.key_of("", "id 1, udp") == missing.key_of("none", "id 1, udp") == "id 1, udp"


def test_autopilot_whose_uid_is_not_received_is_known_by_its_address(tmp_path: Path) -> None:
    missing = MissingReboots.read(tmp_path)
    missing.add("0102", "uav1", ["SYS_A"], at(100.0), address="id 1, udp")
    missing.save()
    again = MissingReboots.read(tmp_path)
    assert again.key_of("", "id 1, udp") == "0102"
    assert again.key_of("none", "id 1, udp") == "id 1, udp", "it is another autopilot"


def test_entry_of_an_address_moves_to_the_uid_that_is_received_later(tmp_path: Path) -> None:
    missing = MissingReboots.read(tmp_path)
    missing.add("0102", "uav1", ["SYS_A"], at(100.0), address="id 1, udp")
    missing.add("id 1, udp", "uav1", ["SYS_B"], at(200.0), address="id 1, udp")
    assert missing.key_of("0102", "id 1, udp") == "0102" and set(missing.autopilots) == {"0102"}
    merged = missing.autopilots["0102"]
    assert merged.parameters == ("SYS_A", "SYS_B") and merged.written_at == 200.0


@pytest.mark.parametrize("value", ["Infinity", "NaN", "1e300", "-1", "true", '"100"', "1" + 400 * "0"])
@pytest.mark.parametrize("key", ["written_at", "uptime_s", "since_boot_s"])
def test_impossible_time_in_the_file_is_refused(tmp_path: Path, key: str, value: str) -> None:
    times = {"written_at": "100", "uptime_s": "null", "since_boot_s": "0"} | {key: value}
    fields = ", ".join(f'"{name}": {text}' for name, text in times.items())
    entry = f'{{"vehicle": "uav1", "parameters": [], {fields}}}'
    (tmp_path / "missing_reboots.json").write_text(
        f'{{"format": "arena missing reboots 1", "autopilots": {{"a": {entry}}}}}'
    )
    with pytest.raises(InputError, match=f"{key} is .*, expected a time"):
        MissingReboots.read(tmp_path)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"format": "arena missing reboots 1", "autopilots": {"a": {}}}']
)
def test_file_that_is_no_record_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "missing_reboots.json").write_text(text)
    with pytest.raises(InputError, match="Reboot all vehicles and delete the file"):
        MissingReboots.read(tmp_path)
