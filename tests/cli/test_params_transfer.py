"""Tests of `arena params push` and `pull` with a fake flight controller on a loopback socket."""

from __future__ import annotations

import io
import itertools
import json
import math
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fake_autopilot import DENIED, INT32, REAL32, REBOOT, REQUEST, FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink
from rebooting_autopilot import RebootingAutopilot, rebooting
from served import Connection, Served, UdpPort, let_pass, until

import arena.cli as cli
from arena.cli import _params_reboot
from arena.cli._params import required_parameters
from arena.cli._params_push import only_push
from arena.cli._params_reboot import RebootsOfPush
from arena.missing_reboots import ClockTime, MissingReboots
from arena.params.facts.parameter_table import parameters
from arena.params.transfer.push_record import PushRecord
from arena.params.transfer.session import PullReport
from arena.schema import load_arena
from arena.schema.address_text import address_text
from arena.wire.qgc_params import parse_params

_count = itertools.count(1)
HELD = {"EKF2_HGT_REF": (1.0, INT32), "MPC_XY_P": (0.95, REAL32)}


@pytest.fixture
def board(tmp_path: Path, runtime_dir: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RebootingAutopilot]:
    """Serve a real vehicle uav1, whose EKF2_HGT_REF takes effect after a reboot only."""
    host = f"127.28.{os.getpid() % 250 + 1}.{next(_count)}"
    autopilot = rebooting(params=dict(HELD))
    connection = Connection(autopilot=autopilot, port=UdpPort((host, 24016)))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    (tmp_path / "arena.yaml").write_text(
        "mocap: {source: natnet, server: 10.0.0.2}\n"
        f"vehicles:\n  uav1: {{autopilot: hardware, profile: iris, url: 'udpout:{host}:24016'}}\n"
    )
    (tmp_path / "new.params").write_text("EKF2_HGT_REF 3\nMPC_XY_P 0.9\n")
    with Served([connection]):
        yield autopilot


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = cli.main(("params", *arguments))
    output = capsys.readouterr()
    return code, output.out, output.err


NEEDS = "uav1 needs a reboot before the new values take effect: EKF2_HGT_REF. Reboot it now."


def test_push_fails_while_a_reboot_is_missing(
    board: FakeAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = run(capsys, "push", "--file", "new.params")
    assert code == 1 and "2 written" in out and NEEDS in out, out + err
    assert board.rebooted == 0 and not Path("push.json").exists()


@pytest.fixture
def waited(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Shorten the waits around a reboot, and collect them [s]."""
    waited: list[float] = []
    monkeypatch.setattr(_params_reboot.time, "sleep", waited.append)
    return waited


REBOOTED = ("push", "--file", "new.params", "--reboot")


def test_push_with_reboot_reads_the_values_again(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str], waited: list[float]
) -> None:
    code, out, err = run(capsys, *REBOOTED)
    assert code == 0 and "uav1: rebooting" in out and NEEDS not in out, out + err
    assert board.rebooted == 1 and _params_reboot.SAVE_S in waited, "PX4 saves the values first"
    assert board.boots == 1 and "uav1: has rebooted, and has kept all 2 values" in out


def test_values_lost_in_the_reboot_are_reported(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str], waited: list[float]
) -> None:
    board.reset, board.dropped = {"MPC_XY_P": (0.95, REAL32)}, {"EKF2_HGT_REF"}
    code, out, err = run(capsys, *REBOOTED)
    assert code == 1, out + err
    assert "uav1: MPC_XY_P: after the reboot the vehicle has 0.95, wanted 0.9" in out
    assert "uav1: EKF2_HGT_REF: after the reboot the vehicle has no such parameter, wanted 3" in out
    assert "uav1: has lost 2 of 2 values in the reboot" in out


def test_vehicle_that_does_not_come_back_is_reported(
    board: RebootingAutopilot,
    capsys: pytest.CaptureFixture[str],
    waited: list[float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(_params_reboot, "RETURN_LIMIT_S", 4.0)
    board.off_s = math.inf
    code, out, err = run(capsys, *REBOOTED)
    assert code == 1 and "uav1: not found again within 4 s after the reboot" in out, out + err


def test_vehicle_that_does_not_reboot_is_reported(
    board: RebootingAutopilot,
    capsys: pytest.CaptureFixture[str],
    waited: list[float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(_params_reboot, "RETURN_LIMIT_S", 4.0)
    board.ack_only_s = math.inf
    code, out, err = run(capsys, *REBOOTED)
    assert code == 1 and "uav1: still reports its earlier boot 4 s after the reboot command. " in out, (
        out + err
    )


def test_vehicle_that_no_longer_reports_its_boot_time_has_not_rebooted(
    board: RebootingAutopilot,
    capsys: pytest.CaptureFixture[str],
    waited: list[float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(_params_reboot, "RETURN_LIMIT_S", 4.0)
    board.ack_only_s = math.inf

    def end_system_time(value: float) -> float:
        board.telemetry = ("HEARTBEAT",)
        return value

    board.clamp["EKF2_HGT_REF"] = end_system_time
    code, out, err = run(capsys, *REBOOTED)
    assert code == 1 and "uav1: not found again within 4 s" in out and MISSING.exists(), out + err


def test_reboot_of_a_vehicle_without_boot_time_is_not_claimed(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str], waited: list[float]
) -> None:
    board.telemetry = ("HEARTBEAT",)
    code, out, err = run(capsys, *REBOOTED)
    assert code == 0 and "has rebooted" not in out and not MISSING.exists(), out + err
    assert (
        "uav1: has answered after the reboot command, does not report its boot time, and has kept all" in out
    )


def test_interrupted_wait_for_a_reboot_is_reported(
    board: RebootingAutopilot,
    capsys: pytest.CaptureFixture[str],
    waited: list[float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(targets: dict[str, Any], *_: Any, **__: Any) -> dict[str, PullReport]:
        return {name: PullReport(ending="interrupted") for name in targets}

    monkeypatch.setattr("arena.params.transfer.session.read_after_reboot", interrupted)
    code, out, err = run(capsys, *REBOOTED)
    assert code == 1 and MISSING.exists(), out + err
    assert "uav1: interrupted (Ctrl-C) before the vehicle was found again: the values after the reboot" in out


def test_refused_reboot_is_reported_and_not_waited_for(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str], waited: list[float]
) -> None:
    board.refuse = {REBOOT: (DENIED, b"")}
    code, out, err = run(capsys, *REBOOTED)
    assert code == 1 and "uav1: the autopilot did not reboot: refused: denied" in out, out + err
    assert _params_reboot.REBOOT_BEGINS_S not in waited


STILL = "uav1 still needs a reboot: a push has written EKF2_HGT_REF on "
MISSING = Path("missing_reboots.json")


def test_missing_reboot_is_reported_until_the_vehicle_has_booted(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(capsys, "push", "--file", "new.params")[0] == 1 and MISSING.exists()
    for options in ((), ("--dry-run",), ()):
        code, out, err = run(capsys, "push", "--file", "new.params", *options)
        assert code == (0 if options else 1) and "2 same" in out, out + err
        assert STILL in out and "and the autopilot has not booted since" in out
        assert (NEEDS in out) == (not options)
    board.goes_at = 0.0
    until(lambda: board.boots == 1)
    code, out, err = run(capsys, "push", "--file", "new.params", "--dry-run")
    assert code == 0 and STILL not in out and MISSING.exists(), "a dry run changes no file"
    code, out, err = run(capsys, "push", "--file", "new.params")
    assert code == 0 and STILL not in out and NEEDS not in out, out + err
    assert not MISSING.exists()


def test_next_push_reboots_for_an_earlier_push(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str], waited: list[float]
) -> None:
    assert run(capsys, "push", "--file", "new.params")[0] == 1
    code, out, err = run(capsys, *REBOOTED)
    assert code == 0 and STILL in out and "has kept all 2 values" in out, out + err
    assert board.boots == 1 and not MISSING.exists()


def test_reboot_that_nobody_has_seen_is_still_missing(
    board: RebootingAutopilot,
    capsys: pytest.CaptureFixture[str],
    waited: list[float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(_params_reboot, "RETURN_LIMIT_S", 4.0)
    board.ack_only_s = math.inf
    assert run(capsys, *REBOOTED)[0] == 1 and MISSING.exists()


def test_unknown_boot_time_does_not_end_a_missing_reboot(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    board.telemetry = ("HEARTBEAT",)
    assert run(capsys, "push", "--file", "new.params")[0] == 1
    code, out, err = run(capsys, "push", "--file", "new.params")
    assert code == 1 and STILL in out and "Use --reboot. If it has rebooted since" in out, out + err
    assert f'remove the entry "{address()}" from ' in out


def address() -> str:
    """Return the address of uav1, as text."""
    arena = load_arena("arena.yaml")
    return address_text(arena, arena.vehicles[0])


def test_missing_reboot_is_saved_before_the_value_is_sent(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    saved: list[tuple[str, ...]] = []

    def save(value: float) -> float:
        saved.extend(each.parameters for each in MissingReboots.read(Path()).autopilots.values())
        return value

    board.clamp["EKF2_HGT_REF"] = save
    code, out, err = run(capsys, "push", "--file", "new.params")
    assert code == 1 and STILL not in out and NEEDS in out, out + err
    assert saved == [("EKF2_HGT_REF",)]


def test_push_record_is_deleted_after_the_missing_reboots_are_saved(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    after_push, existed = RebootsOfPush.after_push, []

    def watch(reboots: RebootsOfPush, *arguments: Any, **options: Any) -> Any:
        existed.append(Path("push.json").exists())
        return after_push(reboots, *arguments, **options)

    monkeypatch.setattr(RebootsOfPush, "after_push", watch)
    run(capsys, "push", "--file", "new.params")
    assert existed == [True] and not Path("push.json").exists()


def test_resumed_push_records_the_reboots_of_completed_vehicles(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    with Path("arena.yaml").open("a") as file:
        file.write("  uav2: {autopilot: hardware, profile: iris, url: 'udpout:127.0.0.1:24017'}\n")
    arena = load_arena("arena.yaml")
    at = {v.name: address_text(arena, v) for v in arena.vehicles}
    record = PushRecord.begin(Path("push.json"), {name: {"EKF2_HGT_REF": 3.0} for name in at}, at)
    record.update("uav1", {"EKF2_HGT_REF": 1.0}, {}, "", unknown={"EKF2_HGT_REF": 3.0})
    record.update("uav2", {"EKF2_HGT_REF": 1.0}, {"EKF2_HGT_REF": 3.0}, "done", "0102")
    record.save()
    code, out, err = run(capsys, "push", "--resume", "--dry-run")
    assert code == 0 and not MISSING.exists(), out + err
    code, out, err = run(capsys, "push", "--resume")
    assert code == 1 and NEEDS in out and not Path("push.json").exists(), out + err
    missing = MissingReboots.read(Path()).autopilots
    assert {each.vehicle for each in missing.values()} == {"uav1", "uav2"}
    assert missing["0102"].parameters == ("EKF2_HGT_REF",)


def test_clock_that_was_set_removes_no_missing_reboot(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(capsys, "push", "--file", "new.params")[0] == 1
    raw = json.loads(MISSING.read_text())
    for entry in raw["autopilots"].values():
        entry["written_at"] -= 86400.0
    MISSING.write_text(json.dumps(raw))
    code, out, err = run(capsys, "push", "--file", "new.params")
    assert code == 1 and STILL in out, out + err


def test_missing_reboot_is_found_without_the_uid(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    board.uid2 = bytes(range(1, 19))
    assert run(capsys, "push", "--file", "new.params")[0] == 1
    assert list(MissingReboots.read(Path()).autopilots) == [board.uid2.hex()]
    board.ignore = {REQUEST}
    code, out, err = run(capsys, "push", "--file", "new.params")
    assert code == 1 and STILL in out, out + err


def test_wrong_file_of_missing_reboots_stops_before_the_first_write(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = '{"vehicle": "uav1", "parameters": ["SYS_A"], "written_at": Infinity}'
    MISSING.write_text(f'{{"format": "arena missing reboots 1", "autopilots": {{"{address()}": {entry}}}}}')
    code, out, err = run(capsys, "push", "--file", "new.params")
    assert code == 2 and "written_at is inf, expected a time" in err, out + err
    assert board.received == [] and board.written_names == []


PX4_1_15_4, UNKNOWN = 0x010F04FF, 0
REFUSED = (
    "uav1: nothing was written: the vehicle has firmware 1.15.4, but the values were generated for PX4 1.16. "
    'The two versions have different parameters. Write `px4_version: "1.15"` for the vehicle in the YAML, or use --px4-version 1.15'
)


def test_late_report_of_another_px4_version_stops_a_push(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    board.version, board.ignore = PX4_1_15_4, {REQUEST}
    board.params = required("1.16") | {"EKF2_HGT_REF": (1.0, INT32), "MPC_XY_P": (0.5, REAL32)}

    def report(value: float) -> float:
        board.ignore = set()
        nothing = [0] * 8
        version = mavlink.MAVLink_autopilot_version_message(
            0, board.version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 0
        )
        board._texts.append(version)
        return value

    board.clamp["EKF2_HGT_REF"] = report
    code, out, err = run(capsys, "push")
    assert code == 1 and "nothing was written" not in out, out + err
    assert "uav1: the push has stopped: the vehicle has firmware 1.15.4, but the values" in out
    assert "\n  EKF2_HGT_REF: " in out and "\n  uav1 needs a reboot for EKF2_HGT_REF" in out
    assert "warning: the vehicle" not in out


def test_resumed_push_of_an_earlier_format_compares_the_px4_version(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    record = PushRecord.begin(Path("push.json"), {"uav1": {"MPC_XY_P": 0.9}}, {"uav1": address()})
    record.update("uav1", {"MPC_XY_P": 0.95}, {}, "interrupted", unknown={"MPC_XY_P": 0.9})
    record.save()
    raw = json.loads(record.path.read_text())
    del raw["vehicles"]["uav1"]["px4_version"]
    record.path.write_text(json.dumps(raw))
    board.version = PX4_1_15_4
    code, out, err = run(capsys, "push", "--resume")
    assert code == 1 and REFUSED in out and board.written_names == [], out + err
    assert run(capsys, "push", "--resume", "--px4-version", "1.15")[0] == 1, "the record has the version now"
    record.path.write_text(json.dumps(raw))
    code, out, err = run(capsys, "push", "--resume", "--px4-version", "1.15")
    assert code == 0 and "1 written" in out, out + err


def required(version: str) -> dict[str, tuple[float, int]]:
    """Return the required parameters of uav1 with their values, except one value."""
    arena, table = load_arena("arena.yaml"), parameters(version)
    values = required_parameters(arena, arena.vehicles[0], version).values
    kinds = {name: INT32 if table[name].type == "INT32" else REAL32 for name in values}
    return {name: (value, kinds[name]) for name, value in values.items()} | {"EKF2_HGT_REF": (1.0, INT32)}


@pytest.mark.parametrize("options", [(), ("--dry-run",)])
def test_values_for_another_px4_version_are_not_written(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str], options: tuple[str, ...]
) -> None:
    board.version = PX4_1_15_4
    code, out, err = run(capsys, "push", *options)
    assert code == 1 and REFUSED in out, out + err
    let_pass(board, 3)
    assert board.written_names == [] and not {m.get_type() for m in board.received} & {"PARAM_SET"}
    if not options:
        code, out, err = run(capsys, "push", "--resume")
        assert code == 1 and REFUSED in out, "the record has the version"


@pytest.mark.parametrize(
    ("version", "options", "warning"),
    [
        (PX4_1_15_4, ("--px4-version", "1.15"), ""),
        (0x011000FF, (), ""),
        (0x011003C0, (), ""),
        (
            UNKNOWN,
            (),
            "does not report the version of its firmware; names and limits of the parameters are those",
        ),
        (
            PX4_1_15_4,
            ("--file", "new.params"),
            "has firmware 1.15.4; names and limits of the parameters are those",
        ),
    ],
)
def test_values_for_the_right_or_an_unknown_px4_version_are_written(
    board: RebootingAutopilot,
    capsys: pytest.CaptureFixture[str],
    version: int,
    options: tuple[str, ...],
    warning: str,
) -> None:
    board.version = version
    board.params |= required(options[1] if options[:1] == ("--px4-version",) else "1.16")
    _, out, err = run(capsys, "push", *options)
    assert "nothing was written" not in out and board.written_names, out + err
    assert f"warning: the vehicle {warning}" in out if warning else "warning: the vehicle" not in out


def test_two_pushes_at_once_are_refused(board: FakeAutopilot, capsys: pytest.CaptureFixture[str]) -> None:
    with only_push(Path()):
        code, _, err = run(capsys, "push", "--file", "new.params")
    assert code == 2 and "another `arena params push` runs. Wait until it has ended" in err
    assert board.params["MPC_XY_P"][0] == 0.95
    assert run(capsys, "push", "--file", "new.params")[0] == 1, "the lock ends with the push"


def test_push_of_values_without_a_reboot_succeeds(
    board: FakeAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("new.params").write_text("MPC_XY_P 0.9\n")
    code, out, err = run(capsys, "push", "--file", "new.params")
    assert code == 0 and "1 written" in out, out + err


def test_resumed_push_still_needs_the_reboot(
    board: FakeAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    arena = load_arena("arena.yaml")
    wanted = {"uav1": {"EKF2_HGT_REF": 1.0, "MPC_XY_P": 0.9}}
    record = PushRecord.begin(Path("push.json"), wanted, {"uav1": address_text(arena, arena.vehicles[0])})
    record.update("uav1", {"EKF2_HGT_REF": 3.0, "MPC_XY_P": 0.95}, {"EKF2_HGT_REF": 1.0}, "interrupted")
    record.save()
    code, out, err = run(capsys, "push", "--resume")
    assert code == 1 and NEEDS in out, out + err


def test_resumed_push_after_a_reboot_needs_no_reboot(
    board: RebootingAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    arena = load_arena("arena.yaml")
    at = address_text(arena, arena.vehicles[0])
    record = PushRecord.begin(
        Path("push.json"), {"uav1": {"EKF2_HGT_REF": 1.0, "MPC_XY_P": 0.9}}, {"uav1": at}
    )
    record.update("uav1", {"EKF2_HGT_REF": 3.0, "MPC_XY_P": 0.95}, {"EKF2_HGT_REF": 1.0}, "interrupted")
    record.save()
    missing = MissingReboots.read(Path())
    missing.add(at, "uav1", ["EKF2_HGT_REF"], ClockTime(unix_s=time.time() - 2 * board.age_s))
    missing.save()
    code, out, err = run(capsys, "push", "--resume")
    assert code == 0 and "1 same, 1 written" in out and NEEDS not in out, out + err


def test_dry_run_never_reboots(board: FakeAutopilot, capsys: pytest.CaptureFixture[str]) -> None:
    arena = load_arena("arena.yaml")
    at = {"uav1": address_text(arena, arena.vehicles[0])}
    record = PushRecord.begin(Path("push.json"), {"uav1": {"EKF2_HGT_REF": 1.0}}, at)
    record.update("uav1", {"EKF2_HGT_REF": 3.0}, {"EKF2_HGT_REF": 1.0}, "interrupted")
    record.save()
    code, out, err = run(capsys, "push", "--resume", "--dry-run", "--reboot")
    assert code == 0 and "rebooting" not in out, out + err
    assert board.rebooted == 0


def test_pull_replaces_an_existing_file_only_with_force(
    board: FakeAutopilot, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(capsys, "pull", "-o", "backup")[0] == 0
    file = Path("backup/uav1.params")
    assert parse_params(file.read_text())["MPC_XY_P"] == pytest.approx(0.95)
    file.write_text("MPC_XY_P 0.5\n")
    let_pass(board, 3)
    requests = len(board.received)
    code, _, err = run(capsys, "pull", "-o", "backup")
    assert (
        code == 2 and "backup/uav1.params: the file exists, and nothing was read" in err and "--force" in err
    )
    let_pass(board, 3)
    assert file.read_text() == "MPC_XY_P 0.5\n" and len(board.received) == requests
    assert run(capsys, "pull", "-o", "backup", "--force")[0] == 0
    assert parse_params(file.read_text())["MPC_XY_P"] == pytest.approx(0.95)
    assert [path.name for path in file.parent.iterdir()] == ["uav1.params"], "no temporary file is left"


def test_failed_pull_keeps_the_existing_file(
    board: FakeAutopilot, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("uav1.params").write_text("MPC_XY_P 0.5\n")

    def fail(file: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    code, _, err = run(capsys, "pull", "--force")
    assert code == 2 and "No space left on device" in err
    assert Path("uav1.params").read_text() == "MPC_XY_P 0.5\n"
    assert not list(Path().glob(".uav1*"))
