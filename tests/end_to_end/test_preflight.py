"""`arena preflight` in a running arena: a fake autopilot and a NatNet server of its own stand in for vehicle and cameras. review fault 2"""

from __future__ import annotations

import json
import math
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from carried import STANDING, Captured, Motion
from fake_autopilot import REAL32
from served import Connection, Served, UdpPort

from .carried_vehicle import TELEMETRY, Cameras, CarriedAutopilot
from .flight import Flight, Hangar, eventually

pytestmark = pytest.mark.crowd  # a vehicle and cameras that must not pause for half a second
TRIES = 4


@dataclass
class Lab:
    """A running arena with a vehicle that nobody has moved yet, and its cameras."""

    hangar: Hangar
    vehicle: CarriedAutopilot
    flight: Flight

    @property
    def record(self) -> Path:
        return self.hangar.folder / "preflight" / "uav1.json"

    def refusals(self) -> str:
        found: dict[str, Any] = self.flight.status()["processes"]["link.uav1"]["stats"]
        return "; ".join(found.get("may_not_arm", ["not reported yet"]))

    def until(self, words: str, *, said: bool) -> None:
        """Wait until the reasons not to arm contain the words, or do not."""
        eventually(lambda: (words in self.refusals()) is said, 30, f"{words!r}: {said}", self.refusals)

    def check(self, moves: Motion) -> tuple[int, str]:
        """Run `arena preflight uav1`, and carry the vehicle when the command says so. Return exit code and output."""
        for _ in range(TRIES):
            with self.flight.start_cli("preflight", "uav1") as command:
                assert command.stdout is not None
                lines: list[str] = []
                for line in command.stdout:
                    lines.append(line)
                    if "Lift the vehicle" in line:
                        moves.begin = time.monotonic() + 0.5
            moves.begin = math.inf
            if not any("during the motion" in line or "Too slow" in line for line in lines):
                break  # this computer did not pause
        return command.returncode, "".join(lines)


@contextmanager
def open_lab(hangar: Hangar) -> Iterator[Lab]:
    """Start the arena, the vehicle and the cameras of a lab, and wait for the arm permit."""
    a, b, c, d = hangar.address.split(".")
    room, here = f"{a}.{int(b) + 60}.{c}.{d}", (hangar.address, 14540)
    file = hangar.folder / "arena.yaml"
    file.write_text(f"""\
name: preflight
address: {hangar.address}
mocap: {{source: natnet, server: {room}, transport: unicast, rate_hz: 60}}
preflight: {{params: false, battery: 0}}
vehicles:
  uav1: {{autopilot: hardware, profile: iris, radio: none, url: "udpin:{here[0]}:{here[1]}"}}
""")
    vehicle = CarriedAutopilot(
        system=1,
        uid2=bytes(range(1, 19)),
        telemetry=TELEMETRY,
        moves=Motion(begin=math.inf),
        params={"EKF2_EV_DELAY": (0.0, REAL32)},
    )
    cameras = Cameras(
        address=room, bodies={"uav1": Captured(moves=vehicle.moves), "uav2": Captured(moves=STANDING)}
    )
    connection = Connection(autopilot=vehicle, port=UdpPort((hangar.address, 14999)), remote=here)
    with cameras, Served([connection]):
        flight = hangar.up(file, "--yes", "--no-report")
        made = Lab(hangar, vehicle, flight)
        eventually(
            lambda: any("arm permit granted" in entry.get("event", "") for entry in flight.events()),
            60,
            "the permit",
            flight.said,
        )
        yield made


@pytest.fixture
def lab(hangar: Hangar) -> Iterator[Lab]:
    with open_lab(hangar) as made:
        yield made


@pytest.fixture(scope="module")
def shared_lab(shared_hangar: Hangar) -> Iterator[Lab]:
    """Give a lab for all tests that leave its vehicle as they found it."""
    with open_lab(shared_hangar) as made:
        yield made


@pytest.mark.alone  # the movement is sampled in real time
def test_a_carried_vehicle_passes_and_stays_checked_until_its_battery_is_changed(lab: Lab) -> None:
    lab.until("no axes check: run arena preflight uav1", said=True)
    code, out = lab.check(lab.vehicle.moves)
    assert code == 0 and "uav1: passed" in out, out
    assert "Tilt it right side down" in out and "next best 'uav2'" in out and "EKF2_EV_DELAY is 0" in out
    assert "Leave the room, then run `arena arm-permit uav1`" in out
    lab.until("axes check", said=False)
    assert json.loads(lab.record.read_text())["definition"] == "name uav1, id 1"
    assert not lab.vehicle.armed and not lab.vehicle.written_names
    assert lab.flight.cli("restart", "link.uav1").returncode == 0
    lab.until("no arm permit", said=True)
    lab.until("axes check", said=False)
    lab.vehicle._began = time.monotonic()  # it boots again
    lab.until("has rebooted: run arena preflight uav1", said=True)


def test_another_body_of_the_cameras_fails(shared_lab: Lab) -> None:
    real, shared_lab.vehicle.moves = shared_lab.vehicle.moves, Motion(begin=math.inf)
    try:
        code, out = shared_lab.check(shared_lab.vehicle.moves)
    finally:
        shared_lab.vehicle.moves = real
    assert real.begin == math.inf
    assert code != 0 and "the captured body 'uav1' did not move with the vehicle" in out, out
    assert not shared_lab.record.exists()
    shared_lab.until("no axes check: run arena preflight uav1", said=True)


def test_what_cannot_be_checked_is_refused(shared_lab: Lab) -> None:
    refused = shared_lab.flight.cli("preflight", "uav9")
    assert refused.returncode != 0 and "expected a real vehicle: uav1" in refused.stderr
    shared_lab.vehicle.armed = True
    eventually(lambda: shared_lab.flight.fact("uav1.armed"), 20, "armed", shared_lab.flight.said)
    armed = shared_lab.flight.cli("preflight", "uav1")
    assert armed.returncode != 0 and "nobody must lift an armed vehicle" in armed.stdout
    shared_lab.vehicle.armed = False
    eventually(lambda: not shared_lab.flight.fact("uav1.armed"), 20, "disarmed", shared_lab.flight.said)


def test_permit_during_the_check_is_refused_with_its_reason(shared_lab: Lab) -> None:
    with shared_lab.flight.start_cli("preflight", "uav1") as command:
        assert command.stdout is not None
        next(line for line in command.stdout if "Lift the vehicle" in line)
        refused = shared_lab.flight.cli("arm-permit", "uav1")
        command.send_signal(signal.SIGINT)
    assert refused.returncode != 0
    assert "uav1: got no arm permit: the axes check is running" in refused.stderr, refused.stderr
