"""Transports to the flight controller, without a link process."""

from __future__ import annotations

import socket
import threading
from typing import Any

import pytest

from arena.errors import RunError
from arena.fcu_link import transports
from arena.fcu_link.transports import UdpTransport
from arena.transport import ConnectionUrl, parse_url

from .link_rig import own_address

CORE: Any = None  # opening a socket does not need it


def held_port() -> tuple[socket.socket, ConnectionUrl]:
    """Return a socket that holds a free UDP port, and the connection that needs this port."""
    holder = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    holder.bind((own_address(), 0))
    host, port = holder.getsockname()
    return holder, parse_url(f"udpin:{host}:{port}")


def test_port_that_land_all_releases_is_opened() -> None:
    holder, connection = held_port()
    release = threading.Timer(0.2, holder.close)
    release.start()
    transport = UdpTransport(connection, CORE)
    release.join()
    assert transport.fileno() is not None
    transport.close()


def test_port_of_another_program_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transports, "_RELEASE_TIMEOUT_S", 0.1)
    holder, connection = held_port()
    with holder, pytest.raises(RunError, match="another arena listen there"):
        UdpTransport(connection, CORE)
