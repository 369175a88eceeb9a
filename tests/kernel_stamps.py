"""Sockets whose datagrams the kernel stamps: it begins a moment after the first socket of the computer has asked for stamps."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator

import pytest

from arena.transport import AgedSocket, StampAges, open_udp

_LIMIT_S = 60.0


def until_stamped(sending: socket.socket, receiving: AgedSocket) -> None:
    """Wait until the kernel stamps datagrams."""
    to, deadline = receiving._source.getsockname(), time.monotonic() + _LIMIT_S
    while time.monotonic() < deadline:
        sending.sendto(b"probe", to)
        time.sleep(0.05)
        if any(age_s > 0.03 for _, _, age_s in receiving.receive()):
            return
    raise AssertionError("the kernel stamps no datagrams")


@pytest.fixture(scope="module", autouse=True)
def kernel_stamps() -> Iterator[None]:
    """Keep a socket with stamps open while the tests of a module run. A module imports this fixture to use it."""
    now, host = time.monotonic(), f"127.75.2.{os.getpid() % 250 + 1}"
    receiving = AgedSocket(open_udp((host, 0)), StampAges(time.time(), now), now)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        sending.bind((host, 0))
        until_stamped(sending, receiving)
    yield
    receiving.close()
