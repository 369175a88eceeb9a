"""Tests of `arena params push` and `pull` with a fake flight controller on a loopback socket."""

from __future__ import annotations

import io
import itertools
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_autopilot import INT32, REAL32, FakeAutopilot
from served import Connection, Served, UdpPort

import arena.cli as cli
from arena.cli._params import address_text
from arena.params.transfer.push_record import PushRecord
from arena.schema import load_arena

_count = itertools.count(1)
HELD = {"EKF2_HGT_REF": (1.0, INT32), "MPC_XY_P": (0.95, REAL32)}


@pytest.fixture
def board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeAutopilot]:
    """Serve a real vehicle uav1, whose EKF2_HGT_REF takes effect after a reboot only."""
    host = f"127.28.{os.getpid() % 250 + 1}.{next(_count)}"
    autopilot = FakeAutopilot(params=dict(HELD), telemetry=("HEARTBEAT",))
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


def test_push_with_reboot_succeeds(board: FakeAutopilot, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "push", "--file", "new.params", "--reboot")
    assert code == 0 and "uav1: rebooting" in out and NEEDS not in out, out + err
    assert board.rebooted == 1


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
