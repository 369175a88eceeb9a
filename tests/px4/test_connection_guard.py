"""Who is let in at a vehicle's simulator port: whoever speaks MAVLink first, and nobody else."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest

from arena.px4 import connection_guard as module
from arena.px4 import lockstep

from .fake import FakePx4, World, greeting


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lockstep, "REPLY_TIMEOUT_S", 5.0)


@pytest.fixture
def one() -> Iterator[World]:
    made = World(1)
    yield made
    made.links.close()


def knock(world: World) -> socket.socket:
    made = socket.create_connection(world.places[0], 5.0)
    made.settimeout(5.0)
    return made


def hung_up(connection: socket.socket) -> bool:
    """Has the world closed it? What it sent before that counts as having been let in."""
    connection.setblocking(False)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def test_a_silent_client_does_not_block_px4(one: World) -> None:
    with knock(one) as stranger:
        one.step(5)
        assert one.status() == ["never connected"]
        FakePx4(one.places[0], [0.5] * 4)
        one.until(lambda: one.status() == ["in step"])
        assert hung_up(stranger)
        assert one.step(20).tolist() == [[0.5] * 4]


def test_a_client_from_another_address_is_refused(one: World) -> None:
    host, port = one.places[0]
    with socket.create_connection((host, port), source_address=("127.66.31.9", 0)) as stranger:
        stranger.sendall(greeting())
        one.until(lambda: hung_up(stranger))
    assert one.links.stats()["uav1"]["strangers"] == 1 and one.status() == ["never connected"]
    assert "it comes from another address than this computer's, so it is no PX4" in one.said[0]


def test_a_silent_client_is_closed_counted_and_reported_once(
    one: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "IDENTIFY_TIMEOUT_S", 0.05)
    for n in (1, 2):
        with knock(one) as stranger:
            one.until(lambda: hung_up(stranger))
            assert one.links.stats()["uav1"]["strangers"] == n
    host, port = one.places[0]
    assert len(one.said) == 1 and one.said[0].startswith(
        f"uav1: simulator port {host}:{port}: a connection from "
    )
    assert one.said[0].endswith("was closed: it sent nothing valid within 0.05 s, so it is no PX4")


@pytest.mark.parametrize("rubbish", [b"GET / HTTP/1.0\r\n\r\n", b"\0" * 40, greeting()[1:20] + b"\xff" * 300])
def test_a_client_that_sends_no_mavlink_is_closed_at_once(
    one: World, rubbish: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "IDENTIFY_TIMEOUT_S", 3600.0)
    with knock(one) as stranger:
        stranger.sendall(rubbish)
        one.until(lambda: hung_up(stranger))
        assert "does not send MAVLink" in one.said[0] and one.status() == ["never connected"]


def test_px4_is_recognised_by_a_heartbeat_in_pieces(one: World) -> None:
    with knock(one) as px4:
        for byte in greeting():
            px4.sendall(bytes([byte]))
            one.step()
        one.until(lambda: one.status() == ["booting"])


def test_further_clients_are_refused_and_reported_once(one: World) -> None:
    px4 = FakePx4(one.places[0], [0.5] * 4)
    one.until_in_step()
    for _ in range(3):
        with knock(one) as second:
            second.sendall(greeting())
            one.until(lambda: hung_up(second))
    assert one.status() == ["in step"] and one.links.stats()["uav1"]["refused"] == 3
    assert [text for text in one.said if "was refused" in text] == one.said[1:2]
    before = len(px4.samples)
    assert one.step(20).tolist() == [[0.5] * 4] and len(px4.samples) >= before + 19


def test_a_hitl_controller_flies_and_is_never_awaited(one: World) -> None:
    controller = FakePx4(one.places[0], [0.5] * 4, free_run=0, flags=0)
    one.until(lambda: one.step().tolist() == [[0.5] * 4])
    controller.mute()
    began = time.monotonic()
    one.step(200)
    assert time.monotonic() - began < 200 * lockstep.REPLY_TIMEOUT_S / 2, "it was waited for"
    assert one.status() == ["booting"] and one.said == ["uav1: PX4 connected"]
    controller.hang_up()
