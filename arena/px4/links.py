"""The world's side of the simulator API for several PX4s: a TCP server each, stepped together in lockstep.

It has the interface that the world expects of autopilots. Every vehicle that is in step is sent its sample, then all answers
are waited for together; one that is late beyond the limit is named and left out until it answers again, one that hangs up is
named and its motors stop. The others fly on either way.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.errors import RunError
from arena.px4.link import SimulatorLink
from arena.wire.truth import Truth

Array = NDArray[np.float64]

LATE_S = 0.5
_NEVER_S = 20.0  # not connected for so long: say so
_BYTES = 65536


class _Server:
    """One vehicle: its listener, its connection when there is one, and how it stands."""

    def __init__(self, name: str, row: int, address: tuple[str, int], rotors: int) -> None:
        self.name, self.row, self.address = name, row, address
        self.core = SimulatorLink(rotors)
        self.connection: socket.socket | None = None
        self.late_since: float | None = None
        self.ever = False
        self.listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self.listener.bind(address)
        except OSError as error:
            raise RunError(f"{name}: cannot serve the simulator API on {address[0]}:{address[1]}: {error.strerror}") from error
        self.listener.listen(1)
        self.listener.setblocking(False)

    @property
    def waiting(self) -> bool:
        """Its answer to the last sample has not come, and is waited for."""
        return self.connection is not None and self.late_since is None and self.core.in_step and self.core.owed > 0

    @property
    def status(self) -> str:
        if self.connection is None:
            return "gone" if self.ever else "never connected"
        return "late" if self.late_since is not None else "in step" if self.core.in_step else "booting"


class Px4Links:
    """vehicles: the world slice's rows that fly PX4 (`simulator`: its address); origin: lat, lon [deg], alt [m], or None."""

    def __init__(self, vehicles: Sequence[Mapping[str, Any]], origin: tuple[float, float, float] | None = None) -> None:
        self._origin = origin
        self._rotors = max((len(v["profile"]["rotors"]) for v in vehicles), default=4)
        self._servers = [
            _Server(v["name"], i, (v["simulator"][0], int(v["simulator"][1])), len(v["profile"]["rotors"]))
            for i, v in enumerate(vehicles)
        ]
        self._poll = select.poll()
        self._by_fd: dict[int, _Server] = {}
        self._events: list[str] = []
        self._begun = time.monotonic()
        self._missing_told = False
        self._truth: Truth | None = None

    @property
    def armed(self) -> NDArray[np.bool_]:
        return np.array([s.core.armed for s in self._servers], bool)

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """PX4 has its own MAVLink links: nothing comes this way."""

    def transmit(self) -> list[tuple[int, str, bytes]]:
        return []

    def see(self, truth: Truth) -> None:
        """What is true now, for the ground truth in PX4's own log. Rows as in `vehicles`."""
        self._truth = truth

    def step(self, now: float, sensors: Mapping[str, Array]) -> Array:
        """One sensor period ends at now [s]: send, wait for who is in step. -> motor commands 0..1 (V, R)."""
        self._accept()
        for server in self._servers:
            self._send(server, now, sensors)
        self._collect()
        motors = np.zeros((len(self._servers), self._rotors))
        for server in self._servers:
            motors[server.row, : len(server.core.motors)] = server.core.motors
        return motors

    def events(self) -> list[str]:
        found, self._events = self._events, []
        return found

    def stats(self) -> dict[str, Any]:
        return {s.name: {"px4": s.status, "armed": s.core.armed, **s.core.counts} for s in self._servers}

    def close(self) -> None:
        for server in self._servers:
            server.listener.close()
            if server.connection is not None:
                server.connection.close()

    # -- connections -----------------------------------------------------------------------------------------------------

    def _accept(self) -> None:
        absent = [s for s in self._servers if s.connection is None]
        for server in absent:
            try:
                connection, _ = server.listener.accept()
            except OSError:
                continue
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            server.connection, server.late_since = connection, None
            server.core.reset()
            self._by_fd[connection.fileno()] = server
            self._poll.register(connection, select.POLLIN)
            self._events.append(f"{server.name}: PX4 connected" + (" again" if server.ever else ""))
            server.ever = True
        self._tell_missing()

    def _tell_missing(self) -> None:
        missing = [s for s in self._servers if not s.ever]
        if missing and not self._missing_told and time.monotonic() - self._begun > _NEVER_S:
            self._missing_told = True
            ports = ", ".join(f"{s.name} ({s.address[0]}:{s.address[1]})" for s in missing)
            self._events.append(f"PX4 has not connected to the simulator port after {_NEVER_S:g} s: {ports}. Its log says why")

    def _hang_up(self, server: _Server, why: str) -> None:
        connection = server.connection
        if connection is None:
            return
        self._poll.unregister(connection)
        self._by_fd.pop(connection.fileno(), None)
        connection.close()
        server.connection, server.late_since = None, None
        what = "its motors stop, the world goes on without it" if server.core.armed else "it was not armed"
        server.core.reset()
        self._events.append(f"{server.name}: PX4 {why}: {what}")

    # -- one step --------------------------------------------------------------------------------------------------------

    def _send(self, server: _Server, now: float, sensors: Mapping[str, Array]) -> None:
        if server.connection is None or server.late_since is not None:
            return
        data = server.core.sample(now, sensors, server.row)
        if self._truth is not None:
            data += server.core.truth(now, self._truth, server.row, self._origin)
        try:
            server.connection.sendall(data)
        except BlockingIOError:
            self._leave_out(server, "does not read its sensors")
        except OSError:
            self._hang_up(server, "has closed the simulator link")

    def _collect(self) -> None:
        """Read whatever has come; wait, together, for those that owe an answer."""
        deadline = time.monotonic() + LATE_S
        while True:
            waiting = [s for s in self._servers if s.waiting]
            left = deadline - time.monotonic()
            for fd, _ in self._poll.poll(max(0.0, 1e3 * left) if waiting else 0):
                self._read(self._by_fd[fd])
            if not waiting or not any(s.waiting for s in waiting):
                return
            if left <= 0.0:
                for server in waiting:
                    if server.waiting:
                        self._leave_out(server, f"has not answered for {LATE_S:g} s")
                return

    def _read(self, server: _Server) -> None:
        assert server.connection is not None
        try:
            data = server.connection.recv(_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            return self._hang_up(server, "has closed the simulator link")
        server.core.hear(data)
        if server.late_since is not None and server.core.owed == 0:
            silent = time.monotonic() - server.late_since + LATE_S
            server.late_since = None
            self._events.append(f"{server.name}: PX4 answers again after {silent:.1f} s")

    def _leave_out(self, server: _Server, why: str) -> None:
        server.late_since = time.monotonic()
        server.core.motors = np.zeros_like(server.core.motors)
        what = "stopped or overloaded; its motors stop until it answers, the world goes on"
        self._events.append(f"{server.name}: PX4 {why}: {what}")
