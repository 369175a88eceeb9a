"""The program's heartbeat to the copilot: sent in the program's own calls, at most ten times a second."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fake_autopilot import FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink
from served import Address, until

from arena import Heartbeat
from arena.wire.mavlink_codec import Codec

from .conftest import make_uav


class Copilot:
    """The socket of a copilot."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._codec = Codec(0, 0)

    def received(self) -> list[Any]:
        found: list[Any] = []
        while True:
            try:
                found += self._codec.parse(self._socket.recv(2048))
            except BlockingIOError:
                return found

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def copilot() -> Iterator[Copilot]:
    made = Copilot()
    yield made
    made.close()


class SteppedClock:
    t = 5.0

    def now(self) -> float:
        return self.t


def test_heartbeat_is_sent_at_most_ten_times_a_second(copilot: Copilot) -> None:
    clock = SteppedClock()
    heartbeat = Heartbeat(copilot.address, 7, clock)  # type: ignore[arg-type]
    for k in range(100):
        clock.t = 5.0 + 0.0101 * k
        heartbeat.beat()
    received = copilot.received()
    assert len(received) == 10
    assert {(m.get_srcSystem(), m.get_srcComponent(), m.type) for m in received} == {
        (7, 191, mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
    }
    heartbeat.close()


def test_without_a_copilot_nothing_is_sent() -> None:
    Heartbeat(None, 1).beat()


def test_missing_copilot_is_no_error(copilot: Copilot) -> None:
    gone = copilot.address
    copilot.close()
    heartbeat, clock = Heartbeat(gone, 1, SteppedClock()), SteppedClock()  # type: ignore[arg-type]
    for _ in range(3):
        clock.t += 1.0
        heartbeat.beat()


def test_heartbeat_is_made_from_the_supervisors_arguments(tmp_path: Path, copilot: Copilot) -> None:
    profile = {
        "mass_kg": 1.5,
        "radius_m": 0.3,
        "height_m": 0.1,
        "num_rotors": 4,
        "thrust_curve": {"kind": "quadratic"},
    }
    slice_ = {
        "vehicle": "uav3",
        "id": 3,
        "link": "udpin:127.0.0.1:16003",
        "body": "uav3",
        "clock": None,
        "capture": None,
        "profile": profile,
        "neighbours": [],
        "stale_s": 0.5,
        "heartbeat": list(copilot.address),
    }
    (tmp_path / "slice.json").write_text(json.dumps(slice_))
    Heartbeat.from_args(["--uav", str(tmp_path / "slice.json"), "own", "words"]).beat()
    assert [m.get_srcSystem() for m in copilot.received()] == [3]


def test_heartbeats_leave_only_while_methods_run(
    autopilot: FakeAutopilot, address: Address, copilot: Copilot
) -> None:
    with make_uav(address, heartbeat=copilot.address) as uav:
        until(lambda: uav.ekf.age_s < 0.5 and uav.info.is_connected)
        copilot.received()
        links = len(autopilot.heartbeats)
        until(lambda: len(autopilot.heartbeats) >= links + 1)  # the background thread runs
        assert copilot.received() == []  # receiving data is no sign that the main loop runs
        uav.start_offboard_mission()
        assert len(copilot.received()) >= 1
        for _ in range(3):
            uav.set_vel_yaw([0, 0, -1], 0.0, 5)
        assert len(copilot.received()) >= 2
        links = len(autopilot.heartbeats)
        until(lambda: len(autopilot.heartbeats) >= links + 1)
        assert copilot.received() == []
