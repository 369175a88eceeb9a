"""The world's side of the simulator API for several PX4s: a TCP server each, stepped together in lockstep.

It has the interface that the world expects of autopilots. Every vehicle that is in step is sent its sample (`begin`), then all
answers are waited for together (`finish`); one that is late beyond the limit is named and left out until it answers again, one
that hangs up is named and its motors stop. The others fly on either way. A flight controller in the loop never sets the lockstep
flag and is never waited for: it answers when it likes.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.px4.connection_guard import Door
from arena.px4.simulator_link import SimulatorLink
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]

LATE_S = 0.5
_NEVER_S = 20.0  # not connected for so long: say so
_BYTES = 65536
_CROWD = 4  # PX4s from which on the world dozes instead of being woken by each answer
_DOZE_STEP_S, _LONGEST_DOZE_S = 2e-5, 1.5e-3
_FEED_S = 0.004  # between two samples for one that is late
_GPS_EVERY = 25  # steps: ten times a second
_LOOK_EVERY = 16  # steps between two looks at a door behind which a PX4 is at home


class _Server:
    """One vehicle: its door, its connection when there is one, and how it stands."""

    def __init__(self, row: int, vehicle: Mapping[str, Any]) -> None:
        self.name, self.row = str(vehicle["name"]), row
        self.address: tuple[str, int] = vehicle["simulator"][0], int(vehicle["simulator"][1])
        self.has_gps = bool(vehicle.get("gps", False))
        self.core = SimulatorLink(
            len(vehicle["profile"]["rotors"]), sticks=bool(vehicle.get("sticks", False))
        )
        self.connection: socket.socket | None = None
        self.late_since: float | None = None
        self.unsent, self.next_feed = b"", 0.0
        self.ever = False
        self.door = Door(self.name, self.address)

    @property
    def waiting(self) -> bool:
        """Its answer to the last sample has not come, and is waited for."""
        return (
            self.connection is not None
            and self.late_since is None
            and self.core.in_step
            and self.core.owed > 0
        )

    @property
    def status(self) -> str:
        if self.connection is None:
            return "gone" if self.ever else "never connected"
        return "late" if self.late_since is not None else "in step" if self.core.in_step else "booting"


class Px4Links:
    """vehicles: the world slice's rows that fly PX4. `simulator`: where it connects; `gps`, `sticks`: what it has.
    origin: lat, lon [deg], alt [m], or None.
    """

    def __init__(
        self, vehicles: Sequence[Mapping[str, Any]], origin: tuple[float, float, float] | None = None
    ) -> None:
        self._origin = origin
        self._rotors = max((len(v["profile"]["rotors"]) for v in vehicles), default=4)
        self._servers = [_Server(i, v) for i, v in enumerate(vehicles)]
        self._has_gps = any(s.has_gps for s in self._servers)
        self._poll = select.poll()
        self._by_fd: dict[int, _Server] = {}
        self._events: list[str] = []
        self._begun = time.monotonic()
        self._missing_told = False
        self._truth: Truth | None = None
        self._steps, self._doze_s = 0, 2e-4

    @property
    def armed(self) -> NDArray[np.bool_]:
        return np.array([s.core.armed for s in self._servers], bool)

    @property
    def wants_gps(self) -> bool:
        return self._has_gps and self._steps % _GPS_EVERY == 0

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """PX4 has its own MAVLink links: nothing comes this way."""

    def sticks(self, vehicle: int, on: bool) -> None:
        """A pilot's radio goes on or off, its sticks in the middle."""
        self._servers[vehicle].core.sticks = on

    def transmit(self) -> list[tuple[int, str, bytes]]:
        return []

    def see(self, truth: Truth) -> None:
        """What is true now, for the ground truth in PX4's own log. Rows as in `vehicles`."""
        self._truth = truth

    def step(self, now: float, sensors: Mapping[str, Array]) -> Array:
        """`begin`, then `finish`."""
        self.begin(now, sensors)
        return self.finish()

    def begin(self, now: float, sensors: Mapping[str, Array]) -> None:
        """One sensor period ends at now [s]: send everybody its sample. They compute from here on."""
        self._open()
        for server in self._servers:
            self._send(server, now, sensors)

    def finish(self) -> Array:
        """Wait for who is in step. -> motor commands 0..1 (V, R)."""
        self._collect()
        motors = np.zeros((len(self._servers), self._rotors))
        for server in self._servers:
            motors[server.row, : len(server.core.motors)] = server.core.motors
        return motors

    def events(self) -> list[str]:
        found, self._events = self._events, []
        for server in self._servers:
            found += server.door.events
            server.door.events.clear()
        return found

    def stats(self) -> dict[str, Any]:
        return {
            s.name: {"px4": s.status, "armed": s.core.armed, **s.core.counts, **s.door.counts}
            for s in self._servers
        }

    def close(self) -> None:
        for server in self._servers:
            server.door.close()
            if server.connection is not None:
                server.connection.close()

    # -- connections -----------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        """Look at the doors: at every step where a PX4 is missing, now and then where one is there."""
        self._steps += 1
        every = self._steps % _LOOK_EVERY == 0
        doors = [s for s in self._servers if every or s.connection is None]
        if not doors:
            return
        now = time.monotonic()
        for server in doors:
            found = server.door.look(now, taken=server.connection is not None)
            if found is not None:
                self._let_in(server, *found)
        self._tell_missing()

    def _let_in(self, server: _Server, connection: socket.socket, said: bytes) -> None:
        server.connection, server.late_since = connection, None
        server.core.reset()
        self._by_fd[connection.fileno()] = server
        self._poll.register(connection, select.POLLIN)
        self._events.append(f"{server.name}: PX4 connected" + (" again" if server.ever else ""))
        server.ever = True
        server.core.hear(said)

    def _tell_missing(self) -> None:
        missing = [s for s in self._servers if not s.ever]
        if missing and not self._missing_told and time.monotonic() - self._begun > _NEVER_S:
            self._missing_told = True
            ports = ", ".join(f"{s.name} ({s.address[0]}:{s.address[1]})" for s in missing)
            self._events.append(
                f"PX4 has not connected to the simulator port after {_NEVER_S:g} s: {ports}. Its log says why"
            )

    def _hang_up(self, server: _Server, why: str) -> None:
        connection = server.connection
        if connection is None:
            return
        self._poll.unregister(connection)
        self._by_fd.pop(connection.fileno(), None)
        connection.close()
        server.connection, server.late_since, server.unsent = None, None, b""
        what = "its motors stop, the world goes on without it" if server.core.armed else "it was not armed"
        server.core.reset()
        self._events.append(f"{server.name}: PX4 {why}: {what}")

    # -- one step --------------------------------------------------------------------------------------------------------

    def _send(self, server: _Server, now: float, sensors: Mapping[str, Array]) -> None:
        """A late one goes on getting samples, for a PX4 that had nothing to answer must not stay frozen; no faster than the wall
        clock, or it would never catch up with a world that does not wait for it.
        """
        if server.connection is None:
            return
        if server.late_since is not None:
            wall = time.monotonic()
            if wall < server.next_feed:
                return
            server.next_feed = wall + _FEED_S
        if server.unsent:
            return self._put(server, server.unsent)  # it does not read: the newer sample waits for nothing
        data = server.core.sample(now, sensors, server.row)
        if server.has_gps and "lat_deg" in sensors:
            data += server.core.gps(now, sensors, server.row)
        if self._truth is not None:
            data += server.core.truth(now, self._truth, server.row, self._origin)
        self._put(server, data)

    def _put(self, server: _Server, data: bytes) -> None:
        assert server.connection is not None
        try:
            server.unsent = data[server.connection.send(data) :]
        except BlockingIOError:
            server.unsent = data
        except OSError:
            return self._hang_up(server, "has closed the simulator link")
        if server.unsent and server.late_since is None:
            self._leave_out(server, "does not read its sensors")

    def _collect(self) -> None:
        """Read whatever has come; wait, together, for those that owe an answer."""
        deadline = time.monotonic() + LATE_S
        self._doze()
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

    def _doze(self) -> None:
        """Of many, sleep until most have answered rather than be woken by each. How long that is, the last steps have shown."""
        crowd = [s for s in self._servers if s.waiting]
        if len(crowd) < _CROWD:
            return
        time.sleep(self._doze_s)
        for fd, _ in self._poll.poll(0):
            self._read(self._by_fd[fd])
        missing = sum(s.waiting for s in crowd)
        longer = missing > len(crowd) // 4
        self._doze_s = min(self._doze_s + _DOZE_STEP_S, _LONGEST_DOZE_S) if longer else self._doze_s * 0.98

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
        server.core.motors = [0.0] * len(server.core.motors)
        what = "stopped or overloaded; its motors stop until it answers, the world goes on"
        if not server.core.armed:  # as one does that waits disarmed in OFFBOARD for setpoints
            what = "it is disarmed; the world goes on without waiting for it"
        self._events.append(f"{server.name}: PX4 {why}: {what}")
