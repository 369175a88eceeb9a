"""`arena doctor`: what it finds, what it misses, and when it says that nothing can fly."""

from __future__ import annotations

import fcntl
from pathlib import Path

import pytest

import arena.cli as cli
from arena.cli import _health
from arena.cli._health import PACKAGES, Finding, examine
from arena.schema.px4 import WAYS


class FakeMachine:
    """missing: packages that are not there; taken: UDP port -> who holds it."""

    def __init__(self, missing: tuple[str, ...] = (), taken: dict[int, str] | None = None) -> None:
        self.missing, self.taken = missing, taken or {}

    def has_module(self, name: str) -> bool:
        return name not in self.missing

    def has_device(self, path: str) -> bool:
        return False

    def has_command(self, name: str, folder: str) -> bool:
        return True

    def refusal(self, address: str, port: int) -> str:
        assert address == "127.0.0.1"
        return "is in use" if port in self.taken else ""

    def holder(self, address: str, port: int) -> str:
        return self.taken[port]


@pytest.fixture
def nothing_there(tmp_path: Path, runtime_dir: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """No run, no PX4, no lock."""
    monkeypatch.setenv("PATH", "")
    return tmp_path


def examined(folder: Path, **machine: object) -> list[Finding]:
    return list(examine(FakeMachine(**machine), locks=folder, devices=folder))  # type: ignore[arg-type]


def test_a_machine_that_has_everything_but_px4_can_fly(nothing_there: Path) -> None:
    found = examined(nothing_there)
    assert not any(f.fatal for f in found) and not any(f.sign == "missing" for f in found)
    words = "\n".join(map(str, found))
    assert all(f"ok      {name}" in words for name in PACKAGES) and "ok      Python 3." in words
    assert all(way in words for way in WAYS) and "every UDP port of 10 vehicles on 127.0.0.1 is free" in words


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_missing_package_is_fatal_only_if_every_arena_needs_it(nothing_there: Path, package: str) -> None:
    purpose, optional = PACKAGES[package]
    found = [
        f
        for f in examined(nothing_there, missing=(package,))
        if f.what == f"{package} is not installed; used for {purpose}"
    ]
    assert len(found) == 1 and found[0].fatal is not optional


def test_a_port_in_use_is_a_note_with_its_holder(nothing_there: Path) -> None:
    found = [
        f for f in examined(nothing_there, taken={24010: "pid 7 (x)", 14550: ""}) if "UDP port" in f.what
    ]
    assert [(f.sign, f.fatal, f.what) for f in found] == [
        ("note", False, "UDP port 14550 of 127.0.0.1 (a ground station) is in use"),
        ("note", False, "UDP port 24010 of 127.0.0.1 (the autopilot, vehicle 1) is in use by pid 7 (x)"),
    ]


def test_only_the_lock_of_a_running_px4_is_reported(nothing_there: Path) -> None:
    for number in (0, 3):
        (nothing_there / f"px4_lock-{number}").touch()
    with (nothing_there / "px4_lock-3").open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        told = [f.what.partition(" (")[0] for f in examined(nothing_there) if "instance" in f.what]
    assert told == ["PX4 instance 3 is running"]


def test_serial_devices_are_listed_with_their_permission(
    nothing_there: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ttyACM0", "ttyUSB1", "ttyS0"):
        (nothing_there / name).touch()
    monkeypatch.setattr(_health.os, "access", lambda path, mode: str(path).endswith("ttyACM0"))
    told = {
        f.what.rpartition("/")[2].partition(":")[0]: f.sign
        for f in examined(nothing_there)
        if "tty" in f.what
    }
    assert told == {"ttyACM0": "ok", "ttyUSB1": "note"}


def test_stand_in_is_never_reported_as_px4(nothing_there: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PX4_HOME", "stand-in")
    found = [f for f in examined(nothing_there) if "stand-in" in f.what]
    assert len(found) == 1 and found[0].sign == "note" and "unset PX4_HOME" in found[0].what


@pytest.mark.parametrize(
    ("missing", "code", "last"),
    [((), 0, "this computer can run arenas"), (("pybullet",), 2, "this computer cannot run an arena yet")],
)
def test_exit_code_of_doctor_reports_whether_arenas_can_fly(
    nothing_there: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    missing: tuple[str, ...],
    code: int,
    last: str,
) -> None:
    monkeypatch.setattr(_health, "Machine", lambda: FakeMachine(missing))
    assert cli.main(["doctor"]) == code
    assert last in capsys.readouterr().out.splitlines()[-1]
