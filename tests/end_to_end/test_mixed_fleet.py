"""Tests of an arena with a hardware vehicle beside a simulated one.

A simulated world on another loopback address stands in for the real vehicle (MAVLink on UDP) and the cameras (NatNet).
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from .flight import PROGRAMS, Flight, Hangar, eventually
from .posing import PosingRoom, PosingVehicle

pytestmark = pytest.mark.crowd  # two worlds: the arena and the simulated reality
REPORT = True  # with figures of a real vehicle
WIRE_PORT = 14540


def arena(hangar: Hangar, server: str, program: Path | str, args: str = "", more: str = "") -> Path:
    """Write an arena with a simulated uav1 and a hardware uav2 that fly the same program."""
    file = hangar.folder / "arena.yaml"
    file.write_text(f"""\
name: mixed
address: {hangar.address}
world: {{size: [14, 6, 3]}}
mocap: {{source: natnet, server: {server}}}
preflight: {{axes_check: none}}
defaults: {{program: {{path: '{program}', args: [{args}]}}, neighbours: [uav1, uav2]}}
vehicles:
  uav1: {{autopilot: builtin, start: {{position: [3, 1, 0]}}}}
  uav2: {{autopilot: hardware, profile: iris, radio: none, url: "udpin:{hangar.address}:{WIRE_PORT}"{more}}}
""")
    return file


@pytest.fixture
def room(hangar: Hangar) -> Iterator[PosingRoom]:
    a, b, c, d = hangar.address.split(".")
    address = f"{a}.{int(b) + 60}.{c}.{d}"
    posing = PosingVehicle(
        name="uav2", number=2, position=[-2.0, 0.0, 0.0], partner=(hangar.address, WIRE_PORT)
    )
    with PosingRoom(address, posing) as made:
        yield made


def up(
    hangar: Hangar, room: PosingRoom, program: Path, *options: str, args: str = "", more: str = ""
) -> Flight:
    return hangar.up(
        arena(hangar, room.address, program, args, more), "--yes", "--time-limit", "120", *options
    )


def test_real_and_simulated_vehicle_fly_the_same_program(hangar: Hangar, room: PosingRoom) -> None:
    flight = up(hangar, room, PROGRAMS / "fly.py", "--until-done", args="tours")
    highest = 0.0

    def over() -> bool:
        nonlocal highest
        highest = max(highest, -float(room.truth().p_n[0, 2]))
        return flight.process.poll() is not None

    eventually(over, 150, "the end", flight.said)
    assert flight.wait() == 0, flight.said()
    told = flight.summary["vehicles"]
    assert told["uav1"]["judged_by"] == "truth" and told["uav2"]["judged_by"] != "truth"
    for name in ("uav1", "uav2"):
        assert len(told[name]["setpoints"]["each"]) == 4
        assert all(s["error_m"] <= 0.15 for s in told[name]["setpoints"]["each"]), (
            name,
            told[name]["setpoints"],
        )
        assert told[name]["landing"]["landed"]
    assert highest > 1.2  # by the other room's own truth
    end = room.truth().p_n[0]
    assert -end[2] < 0.15 and np.hypot(end[0] + 2.0, end[1]) < 3.0
    flight.assert_nothing_left()


def test_failed_preflight_check_refuses_arming_with_its_reason(hangar: Hangar, room: PosingRoom) -> None:
    options = ("--until-done",)
    soon = f"program: {{path: '{PROGRAMS / 'ready_in_8_s.py'}', args: [lands]}}"
    flight = up(
        hangar,
        room,
        PROGRAMS / "fly.py",
        *options,
        args="lands",
        more=f", params: {{COM_OF_LOSS_T: 7}}, {soon}",
    )
    assert flight.wait(120) == 1
    assert "COM_OF_LOSS_T" in flight.log("program.uav2") and "Preflight" in flight.log("program.uav2")
    assert not any(row["info.is_armed"] == "True" for row in flight.rows("uav2"))
    assert -float(room.truth().p_n[0, 2]) < 0.15
    assert flight.summary["vehicles"]["uav1"]["landing"]["landed"]  # the other has flown


def test_land_all_lands_a_mixed_fleet_without_supervisor_and_router(hangar: Hangar, room: PosingRoom) -> None:
    flight = up(hangar, room, PROGRAMS / "fly.py", args="hovers")
    flight.until_up(0.7)
    eventually(lambda: -room.truth().p_n[0, 2] > 0.7, 30, "the real one in the air", flight.said)
    flight.signal(signal.SIGKILL)
    os.kill(flight.pid("router"), signal.SIGKILL)
    landed = flight.cli("land-all", "--run", str(flight.folder))
    assert landed.returncode == 0, landed.stdout + landed.stderr
    assert "uav1: landed" in landed.stdout and "uav2: landed" in landed.stdout, landed.stdout
    assert -float(room.truth().p_n[0, 2]) < 0.15
