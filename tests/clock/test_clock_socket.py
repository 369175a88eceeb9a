"""The socket of the simulation clock."""

from __future__ import annotations

import socket
from pathlib import Path

from arena.clock import SimClock
from arena.clock_server import ClockServer


def test_socket_appears_only_when_it_accepts_connections(tmp_path, monkeypatch):
    """A client that finds the socket before `listen` would be refused, and its flight would fail."""
    found, listen = [], socket.socket.listen

    def note(self: socket.socket, backlog: int) -> None:
        found.append(Path(tmp_path / "clock.sock").exists())
        listen(self, backlog)

    monkeypatch.setattr(socket.socket, "listen", note)
    server = ClockServer(tmp_path / "clock")
    SimClock(tmp_path / "clock", "a").close()
    server.close()
    assert found == [False]
    assert not list(tmp_path.iterdir())
