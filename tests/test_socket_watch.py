"""Search for sockets with data: in a fast simulation it is left out while all programs sleep."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from arena.socket_watch import POLL_S, SocketWatch


@pytest.fixture
def watched() -> Iterator[tuple[SocketWatch, int, socket.socket]]:
    """Give a watch, the file descriptor that it watches, and the socket that sends to it."""
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    watch = SocketWatch()
    watch.add(here.fileno())
    yield watch, here.fileno(), there
    watch.close()
    here.close()
    there.close()


def test_data_is_found(watched: tuple[SocketWatch, int, socket.socket]) -> None:
    watch, fd, sender = watched
    watch.poll()
    assert not watch.has_data(fd)
    sender.send(b"x")
    watch.poll()
    assert watch.has_data(fd)


@pytest.mark.parametrize(
    ("later_s", "wakes", "found"),
    [
        pytest.param(0.0, 8, True, id="a program was awake"),
        pytest.param(0.9 * POLL_S, 7, False, id="all programs sleep"),
        pytest.param(1.1 * POLL_S, 7, True, id="all programs sleep, half a millisecond later"),
    ],
)
def test_search_is_due_after_a_wake_up_or_half_a_millisecond(
    watched: tuple[SocketWatch, int, socket.socket], later_s: float, wakes: int, found: bool
) -> None:
    watch, fd, sender = watched
    watch.poll_if_due(5.0, 7)
    sender.send(b"x")
    watch.poll_if_due(5.0 + later_s, wakes)
    assert watch.has_data(fd) is found


def test_step_without_a_search_finds_no_data(watched: tuple[SocketWatch, int, socket.socket]) -> None:
    watch, fd, sender = watched
    sender.send(b"x")
    watch.poll_if_due(5.0, 7)
    assert watch.has_data(fd)
    watch.poll_if_due(5.0, 7)
    assert not watch.has_data(fd), "the data were reported: the next search is later"
