"""Lockstep of several fake PX4s with one world, on real sockets: late, lost and new connections."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from arena.errors import RunError
from arena.px4 import lockstep as module
from arena.px4.lockstep import Px4Links
from arena.report.happenings import _of_words
from arena.report.run_data import Event

from .fake import HIL, FakePx4, World

LATE_S = 1.5


@pytest.fixture
def soon_late(patient: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "REPLY_TIMEOUT_S", LATE_S)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Raise the reply timeout, so that a busy machine makes no PX4 late."""
    monkeypatch.setattr(module, "REPLY_TIMEOUT_S", 5.0)


@pytest.fixture
def two() -> Iterator[World]:
    made = World(2)
    yield made
    made.links.close()


def connect(world: World) -> list[FakePx4]:
    px4s = [FakePx4(place, [0.25 * (k + 1)] * 4) for k, place in enumerate(world.places)]
    world.until_in_step()
    return px4s


def test_two_px4s_get_every_sample_once_and_fly_their_motors(two: World) -> None:
    px4s = connect(two)
    two.step()  # now nothing of the free run is under way
    before = [len(p.samples) for p in px4s]
    motors = two.step(200)
    assert [len(p.samples) for p in px4s] == [n + 200 for n in before]
    for px4 in px4s:
        stamps = np.diff([m.time_usec for m in px4.samples])
        assert set(stamps) == {4000}
    assert motors.tolist() == [[0.25] * 4, [0.5] * 4]
    assert two.links.armed.tolist() == [True, True]
    assert two.events == ["uav1: PX4 connected", "uav2: PX4 connected"]


def test_the_world_steps_before_any_px4_connects(two: World) -> None:
    began = time.monotonic()
    assert two.step(500).tolist() == [[0.0] * 4] * 2
    assert time.monotonic() - began < 500 * LATE_S / 2  # nobody is waited for
    assert two.status() == ["never connected"] * 2


def test_a_late_px4_is_reported_and_rejoins(two: World, soon_late: None) -> None:
    px4s = connect(two)
    two.step()  # now no reply of the free run is under way
    px4s[0].stop_reading()
    began = time.monotonic()
    motors = two.step()
    assert time.monotonic() - began >= LATE_S  # it was waited for
    assert motors.tolist() == [[0.0] * 4, [0.5] * 4]
    assert two.status() == ["late", "in step"]
    assert two.events[2:] == [
        f"uav1: PX4 has not replied for {LATE_S:g} s: it is paused by SIGSTOP or overloaded; "
        "its motors stop until it replies, the world goes on"
    ]
    (said,) = _of_words(
        Event(at_s=1.0, process="world", text=two.events[2]), SimpleNamespace(names=("uav1",))
    )
    assert (said.kind, said.level, said.vehicles) == ("process", "bad", ("uav1",)), (
        "the report names the cause"
    )
    began = time.monotonic()
    seen = len(px4s[1].samples)
    two.step(100)
    assert time.monotonic() - began < 90 * LATE_S  # and is waited for no more
    assert len(px4s[1].samples) == seen + 100
    px4s[0].resume_reading()
    two.until_in_step()
    assert two.events[3].startswith("uav1: PX4 replies again after ") and len(two.events) == 4
    assert two.step(50).tolist() == [[0.25] * 4, [0.5] * 4]


def test_a_late_px4_rejoins_a_world_whose_steps_are_slow(soon_late: None) -> None:
    world = World(1)
    try:
        px4 = FakePx4(world.places[0], [0.25] * 4)
        world.until_in_step()
        px4.stop_reading()
        world.until(lambda: world.status() == ["late"])
        px4.resume_reading()
        for _ in range(20):
            time.sleep(0.02)  # longer than the pause between two samples for a late PX4
            world.step()
        assert world.status() == ["in step"]
        assert world.step().tolist() == [[0.25] * 4]
    finally:
        world.links.close()


def test_a_late_px4_whose_reply_is_old_has_no_motors(two: World, soon_late: None) -> None:
    px4s = connect(two)
    px4s[0].stop_reading()
    two.until(lambda: two.status()[0] == "late")
    old = px4s[0].samples[-1].time_usec - 4000
    px4s[0]._reply(old)
    for _ in range(50):
        assert two.step()[0].tolist() == [0.0] * 4
        time.sleep(0.001)
    assert two.status()[0] == "late" and two.links.stats()["uav1"]["late"] == 1
    px4s[0].resume_reading()


def test_a_pause_of_the_whole_computer_makes_no_px4_late(two: World, monkeypatch: pytest.MonkeyPatch) -> None:
    px4s = connect(two)
    two.step()
    stalls = iter([0.0, 0.0, 30.0])
    real, offset = time.monotonic, 0.0

    def monotonic() -> float:
        nonlocal offset
        offset += next(stalls, 0.0)
        return real() + offset

    monkeypatch.setattr(module.time, "monotonic", monotonic)
    px4s[0].stop_reading()
    threading.Timer(0.3, px4s[0].resume_reading).start()  # it replies soon after the pause
    assert two.step().tolist() == [[0.25] * 4, [0.5] * 4]
    assert offset == 30.0 and two.status() == ["in step"] * 2


def test_an_sitl_px4_without_lockstep_is_reported() -> None:
    world = World(1, lockstep=True)
    try:
        FakePx4(world.places[0], [0.25] * 4, flags=0)
        world.until(lambda: world.status() == ["running"])
        world.step(20)
        assert [text for text in world.events if "lockstep" in text] == [
            "uav1: this PX4 does not run in lockstep, so it flies by its own clock: build px4_sitl_default"
        ]
    finally:
        world.links.close()


def test_a_disconnected_px4_is_reported_and_its_motors_stop(two: World) -> None:
    px4s = connect(two)
    px4s[0].disconnect()
    two.until(lambda: two.status()[0] == "gone")
    assert two.step(50).tolist() == [[0.0] * 4, [0.5] * 4]
    assert two.links.armed.tolist() == [False, True]
    assert two.events[2:] == [
        "uav1: PX4 has closed the simulator link: its motors stop, the world goes on without it"
    ]


def test_a_px4_that_disconnects_disarmed_is_no_alarm(two: World) -> None:
    px4 = FakePx4(two.places[0], [0.5] * 4, armed=False)
    two.until(lambda: two.status()[0] == "in step")
    px4.disconnect()
    two.until(lambda: two.status()[0] == "gone")
    assert two.events[-1] == "uav1: PX4 has closed the simulator link: it was not armed"


def test_a_px4_that_reconnects_starts_again(two: World) -> None:
    px4s = connect(two)
    px4s[0].disconnect()
    two.until(lambda: two.status()[0] == "gone")
    again = FakePx4(two.places[0], [0.75] * 4)
    two.until_in_step()
    assert two.events[-1] == "uav1: PX4 connected again"
    assert two.step(10)[0] == pytest.approx([0.75] * 4) and len(again.samples) >= 10


def test_a_disconnect_during_the_wait_does_not_block_the_world(two: World, soon_late: None) -> None:
    px4s = connect(two)
    two.step()  # now no reply of the free run is under way
    px4s[0].stop_reading()
    two.step()
    px4s[0].disconnect()
    two.until(lambda: two.status()[0] == "gone")
    assert two.step(20)[1] == pytest.approx([0.5] * 4)


def test_a_px4_that_never_connects_is_reported_once_with_its_port(
    two: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    FakePx4(two.places[1], [0.5] * 4)
    two.until(lambda: two.status()[1] == "in step")
    monkeypatch.setattr(module, "_CONNECT_TIMEOUT_S", 0.0)
    two.step(20)
    host, port = two.places[0]
    told = [text for text in two.events if "has not connected" in text]
    assert told == [
        f"PX4 has not connected to the simulator port after 0 s: uav1 ({host}:{port}). Its log says why"
    ]


def test_a_taken_port_is_an_error_with_vehicle_and_address(two: World) -> None:
    host, port = two.places[0]
    with pytest.raises(
        RunError, match=f"uav9: cannot serve the simulator API on {host}:{port}: Address already in use"
    ):
        Px4Links([{"name": "uav9", "simulator": [host, port], "profile": {"rotors": [{}] * 4}}], None, HIL)


def test_closing_frees_ports_and_connections(two: World) -> None:
    connect(two)
    two.links.close()
    for place in two.places:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(place, 1.0)
