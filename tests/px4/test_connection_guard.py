"""Admission to a vehicle's simulator port: the first client that sends MAVLink, and no other."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest

from arena.px4 import connection_guard as module
from arena.px4 import lockstep

from .fake import FakePx4, World, first_messages


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lockstep, "REPLY_TIMEOUT_S", 5.0)


@pytest.fixture
def one() -> Iterator[World]:
    made = World(1)
    yield made
    made.links.close()


def connect_raw(world: World) -> socket.socket:
    made = socket.create_connection(world.places[0], 5.0)
    made.settimeout(5.0)
    return made


def is_closed(connection: socket.socket) -> bool:
    """Return whether the world has closed the connection without sending anything."""
    connection.setblocking(False)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def test_a_silent_client_does_not_block_px4(one: World) -> None:
    with connect_raw(one) as client:
        one.step(5)
        assert one.status() == ["never connected"]
        FakePx4(one.places[0], [0.5] * 4)
        one.until(lambda: one.status() == ["in step"])
        assert is_closed(client)
        assert one.step(20).tolist() == [[0.5] * 4]


def test_a_client_from_another_address_is_refused(one: World) -> None:
    host, port = one.places[0]
    with socket.create_connection((host, port), source_address=("127.66.31.9", 0)) as client:
        client.sendall(first_messages())
        one.until(lambda: is_closed(client))
    assert one.links.stats()["uav1"]["strangers"] == 1 and one.status() == ["never connected"]
    assert "it comes from another address than this computer's, so it is not PX4" in one.events[0]


def test_a_silent_client_is_closed_counted_and_reported_once(
    one: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "IDENTIFY_TIMEOUT_S", 0.05)
    for n in (1, 2):
        with connect_raw(one) as client:
            one.until(lambda: is_closed(client))
            assert one.links.stats()["uav1"]["strangers"] == n
    host, port = one.places[0]
    assert len(one.events) == 1 and one.events[0].startswith(
        f"uav1: simulator port {host}:{port}: a connection from "
    )
    assert one.events[0].endswith("was closed: it sent nothing valid within 0.05 s, so it is not PX4")


@pytest.mark.parametrize(
    "data", [b"GET / HTTP/1.0\r\n\r\n", b"\0" * 40, first_messages()[1:20] + b"\xff" * 300]
)
def test_a_client_that_sends_no_mavlink_is_closed_at_once(
    one: World, data: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "IDENTIFY_TIMEOUT_S", 3600.0)
    with connect_raw(one) as client:
        client.sendall(data)
        one.until(lambda: is_closed(client))
        assert "does not send MAVLink" in one.events[0] and one.status() == ["never connected"]


def test_px4_is_recognised_by_a_heartbeat_in_pieces(one: World) -> None:
    with connect_raw(one) as px4:
        for byte in first_messages():
            px4.sendall(bytes([byte]))
            one.step()
        one.until(lambda: one.status() == ["booting"])


def test_further_clients_are_refused_and_reported_once(one: World) -> None:
    px4 = FakePx4(one.places[0], [0.5] * 4)
    one.until_in_step()
    for _ in range(3):
        with connect_raw(one) as second:
            second.sendall(first_messages())
            one.until(lambda: is_closed(second))
    assert one.status() == ["in step"] and one.links.stats()["uav1"]["refused"] == 3
    assert [text for text in one.events if "was refused" in text] == one.events[1:2]
    before = len(px4.samples)
    assert one.step(20).tolist() == [[0.5] * 4] and len(px4.samples) >= before + 19


def test_a_hitl_controller_flies_and_is_never_awaited(one: World) -> None:
    controller = FakePx4(one.places[0], [0.5] * 4, free_run=0, flags=0)
    one.until(lambda: one.step().tolist() == [[0.5] * 4])
    controller.stop_reading()
    began = time.monotonic()
    one.step(200)
    assert time.monotonic() - began < 200 * lockstep.REPLY_TIMEOUT_S / 2, "it was waited for"
    assert one.status() == ["running"] and one.events == ["uav1: PX4 connected"]
    one.until(lambda: one.step().tolist() == [[0.0] * 4])  # frozen motors would fly the vehicle away
    assert one.events[1:] == [
        f"uav1: PX4 has not replied for {lockstep.REPLY_TIMEOUT_S:g} s: its motors stop until it sends motor commands again"
    ]
    controller.resume_reading()
    one.until(lambda: one.step().tolist() == [[0.5] * 4])
    controller.disconnect()
