"""Tests of a flight controller in the loop (HITL): HIL and MAVLink on one serial line."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from arena.plan import make_plan
from arena.schema import load_arena

from .flight import PROGRAMS, ROOT, Hangar, end_with_us

pytestmark = pytest.mark.crowd
BOARD = ROOT / "tests" / "children" / "hitl_board.py"


def write_arena(hangar: Hangar, device: str, program: str) -> Path:
    """Write the YAML of a flight controller at a serial device. program: file in `programs`."""
    file = hangar.folder / "arena.yaml"
    file.write_text(f"""\
name: loop
address: {hangar.address}
vehicles:
  uav1:
    id: 6
    autopilot: hitl
    serial: {device}
    program: {{path: '{PROGRAMS / program}', args: [tours]}}
""")
    return file


def params_of(yaml: Path) -> dict[str, float]:
    params: dict[str, float] = make_plan(load_arena(yaml)).slices["link.uav1.json"]["params"]
    return params


@pytest.fixture
def running() -> Iterator[list[subprocess.Popen[bytes]]]:
    found: list[subprocess.Popen[bytes]] = []
    yield found
    for process in found:
        process.kill()
        process.wait()


def switch_on(params: dict[str, float], device: str, folder: Path) -> subprocess.Popen[bytes]:
    file = folder / "board.params"
    file.write_text("".join(f"{name} {value}\n" for name, value in params.items()))
    # In a session of its own: Linux shares the processors between sessions, and the tests' session can be busy.
    return subprocess.Popen(
        [sys.executable, str(BOARD), device, "6", str(file)],
        start_new_session=True,
        preexec_fn=end_with_us,  # noqa: PLW1509 - no thread has been started here
    )


@pytest.mark.alone  # real time, which a neighbour on the cores would take
def test_hitl_flies_to_setpoints_and_lands(
    hangar: Hangar, serial_cable: tuple[str, str], running: list[subprocess.Popen[bytes]]
) -> None:
    yaml = write_arena(hangar, serial_cable[0], "fly.py")
    running.append(switch_on(params_of(yaml), serial_cable[1], hangar.folder))
    flight = hangar.up(yaml, "--until-done", "--time-limit", "100")
    assert flight.wait(150) == 0, flight.said()
    told = flight.summary["vehicles"]["uav1"]
    assert told["judged_by"] == "truth" and told["landing"]["landed"] and told["crashed"] == ""
    assert len(told["setpoints"]["each"]) == 4 and all(
        s["error_m"] <= 0.25 for s in told["setpoints"]["each"]
    ), told["setpoints"]
    flight.assert_nothing_left()


def test_hitl_board_without_parameters_does_not_arm(
    hangar: Hangar, serial_cable: tuple[str, str], running: list[subprocess.Popen[bytes]]
) -> None:
    yaml = write_arena(hangar, serial_cable[0], "ready_in_8_s.py")
    wrong = {**params_of(yaml), "SYS_HITL": 0}
    running.append(switch_on(wrong, serial_cable[1], hangar.folder))
    flight = hangar.up(yaml, "--until-done", "--time-limit", "60")
    assert flight.wait(120) == 1
    assert "SYS_HITL is 0, needs 1" in flight.said()
    assert "SYS_HITL\t1\t6" in (flight.folder / "params" / "uav1.params").read_text()
    assert not any(row["info.is_armed"] == "True" for row in flight.rows("uav1"))
