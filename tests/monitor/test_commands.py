"""Emergency commands of the page: command lines, and the confirmation of each vehicle."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import pytest

from arena.monitor import commands
from arena.monitor.commands import Command, Commands, argv

RUN = Path("/runs/a")


def command(action, *lines, code=None, vehicles=("uav1", "uav10")):
    return Command(action=action, vehicles=vehicles, began=0.0, lines=list(lines), exit_code=code)


def test_land_is_land_all_of_the_named_vehicles():
    assert argv("land", RUN, ["uav1"])[1:] == [
        "-m",
        "arena",
        "land-all",
        "--run",
        "/runs/a",
        "--only",
        "uav1",
    ]


def test_kill_is_confirmed_on_its_command_line():
    found = argv("kill", RUN, ["uav1", "uav2"])
    assert found[3] == "kill-all" and found[-1] == "--yes" and "uav1,uav2" in found


def test_vehicle_waits_until_its_own_line():
    one = command("land", "landing uav1, uav10", "uav10: landed and disarmed after 4.0 s")
    assert one.result("uav1") == ("waiting", "command sent")
    assert one.result("uav10") == ("confirmed", "landed and disarmed after 4.0 s")


def test_vehicle_that_is_not_confirmed_shows_the_reason():
    one = command("land", "uav1: LAND mode accepted", "uav1: NOT CONFIRMED: armed, OFFBOARD", code=1)
    assert one.result("uav1") == ("not confirmed", "armed, OFFBOARD")


def test_process_without_a_line_about_the_vehicle_has_not_confirmed():
    assert command("land", "no such run", code=2).result("uav1") == ("not confirmed", "no such run")
    assert command("land", code=3).result("uav1") == ("not confirmed", "exit code 3")


def test_landing_that_only_began_is_not_confirmed():
    assert command("land", "uav1: landed state unknown", code=1).result("uav1")[0] == "not confirmed"


@pytest.mark.parametrize(
    ("action", "line"),
    [("hold", "holds its position (AUTO.LOITER) after 0.2 s"), ("kill", "motors stopped after 0.1 s")],
)
def test_each_action_has_its_confirmation(action, line):
    assert command(action, f"uav1: {line}", code=0).result("uav1") == ("confirmed", line)


def test_output_of_the_process_is_read_while_it_runs(monkeypatch, tmp_path):
    gate = tmp_path / "gate"
    code = (
        "import pathlib, sys, time\n"
        "print('uav1: landed and disarmed after 1.0 s', flush=True)\n"
        f"gate = pathlib.Path({str(gate)!r})\n"
        "while not gate.exists():\n    time.sleep(0.01)\n"
    )
    monkeypatch.setattr(commands, "argv", lambda *_: [sys.executable, "-c", code])
    given = Commands()
    one = given.give("land", RUN, ["uav1"])
    deadline = threading.Event()
    for _ in range(3000):
        if one.lines:
            break
        deadline.wait(0.01)
    assert one.result("uav1")[0] == "confirmed" and one.exit_code is None
    gate.touch()
    for _ in range(3000):
        if one.exit_code is not None:
            break
        deadline.wait(0.01)
    assert one.exit_code == 0 and given.newest() == [one]


def test_command_that_cannot_start_is_reported(monkeypatch):
    monkeypatch.setattr(commands, "argv", lambda *_: ["/no/such/program"])
    one = Commands().give("land", RUN, ["uav1"])
    assert one.exit_code == 1 and "could not be started" in one.result("uav1")[1]
