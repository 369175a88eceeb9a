"""The program's heartbeat to the copilot: in its own calls, ten times a second, and never from a thread."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena import Heart
from arena.wire.mavlink_codec import Codec

from .conftest import make_uav
from .fake import FakeAutopilot, until


class Ear:
    """Where a copilot would listen."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._codec = Codec(0, 0)

    def heard(self) -> list[Any]:
        found: list[Any] = []
        while True:
            try:
                found += self._codec.parse(self._socket.recv(2048))
            except BlockingIOError:
                return found

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def ear() -> Iterator[Ear]:
    made = Ear()
    yield made
    made.close()


class HandClock:
    t = 5.0

    def now(self) -> float:
        return self.t


def test_it_beats_ten_times_a_second_of_its_clock_at_most(ear: Ear) -> None:
    clock = HandClock()
    heart = Heart(ear.address, 7, clock)  # type: ignore[arg-type]
    for k in range(100):
        clock.t = 5.0 + 0.0101 * k
        heart.beat()
    heard = ear.heard()
    assert len(heard) == 10
    assert {(m.get_srcSystem(), m.get_srcComponent(), m.type) for m in heard} == {
        (7, 191, mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
    }
    heart.close()


def test_without_a_copilot_beating_is_nothing() -> None:
    Heart(None, 1).beat()


def test_a_copilot_that_is_not_there_is_no_error(ear: Ear) -> None:
    gone = ear.address
    ear.close()
    heart, clock = Heart(gone, 1, HandClock()), HandClock()  # type: ignore[arg-type]
    for _ in range(3):
        clock.t += 1.0
        heart.beat()


def test_a_foreign_program_takes_it_from_the_supervisors_arguments(tmp_path: Path, ear: Ear) -> None:
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
        "heart": list(ear.address),
    }
    (tmp_path / "slice.json").write_text(json.dumps(slice_))
    Heart.from_args(["--uav", str(tmp_path / "slice.json"), "own", "words"]).beat()
    assert [m.get_srcSystem() for m in ear.heard()] == [3]


def test_a_program_beats_while_its_methods_run_and_never_between(autopilot: FakeAutopilot, ear: Ear) -> None:
    with make_uav(autopilot.to, heart=ear.address) as uav:
        until(lambda: uav.ekf.age_s < 0.5 and uav.info.is_connected)
        ear.heard()
        links = len(autopilot.heartbeats)
        until(lambda: len(autopilot.heartbeats) >= links + 1)  # its thread lives
        assert ear.heard() == []  # looking alone is no sign of a loop that flies
        uav.start_offboard_mission()
        assert len(ear.heard()) >= 1
        for _ in range(3):
            uav.set_vel_yaw([0, 0, -1], 0.0, 5)
        assert len(ear.heard()) >= 2
        links = len(autopilot.heartbeats)
        until(lambda: len(autopilot.heartbeats) >= links + 1)
        assert ear.heard() == []
