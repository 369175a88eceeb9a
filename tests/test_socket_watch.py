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


def test_after_a_program_was_awake_data_is_found_at_once(
    watched: tuple[SocketWatch, int, socket.socket],
) -> None:
    watch, fd, sender = watched
    watch.poll_if_due(5.0, 7)
    sender.send(b"x")
    watch.poll_if_due(5.0, 8)
    assert watch.has_data(fd)


def test_while_all_programs_sleep_data_waits_for_half_a_millisecond(
    watched: tuple[SocketWatch, int, socket.socket],
) -> None:
    watch, fd, sender = watched
    watch.poll_if_due(5.0, 7)
    sender.send(b"x")
    watch.poll_if_due(5.0 + 0.9 * POLL_S, 7)
    assert not watch.has_data(fd)
    watch.poll_if_due(5.0 + 1.1 * POLL_S, 7)
    assert watch.has_data(fd)
    watch.poll_if_due(5.0 + 1.2 * POLL_S, 7)
    assert not watch.has_data(fd), "it has been read: the next search is later"
