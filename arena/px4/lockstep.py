"""The simulator's side of PX4's simulator API, for several vehicles in lockstep.

Each vehicle has one TCP server. The module implements the world's `ExternalAutopilots`: `begin` sends a sensor
sample to each vehicle, and `finish` waits for the replies of all vehicles in lockstep.

If a vehicle does not reply in time, this is reported, and the world does not wait for this vehicle until it replies again.
If a vehicle closes its connection, this is reported and its motors stop. The other vehicles fly on in both
cases. A flight controller in the loop (HITL) never sets the lockstep flag, so the world never waits for it.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.px4.connection_guard import ConnectionGuard
from arena.px4.simulator_link import SimulatorLink
from arena.wire.hil import HilMessage, HilOutput
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]

REPLY_TIMEOUT_S, _LONGEST_WAIT_S = 0.5, 0.1  # wall time
_CONNECT_TIMEOUT_S = 20.0  # then an event reports who has not connected
_BYTES = 8192
_SLEEP_FROM = 4  # number of PX4s from which on the world sleeps instead of waking up for each reply
_SLEEP_STEP_S, _MAX_SLEEP_S = 2e-5, 1.5e-3
_LATE_SAMPLE_S = 0.004  # between two samples for a vehicle that is late
_ACCEPT_EVERY = 16  # steps between two checks for new connections where a PX4 is connected


class _Silence:
    """Time for which an autopilot without lockstep, such as a board in the loop (HITL), has sent no motor commands.

    A pause between two calls of `update` counts as `_LONGEST_WAIT_S` at most, because the whole computer may have stood still.
    """

    def __init__(self) -> None:
        self._replies, self._silent_s, self._updated = 0, 0.0, 0.0
        self.reported = False

    def update(self, replies: int, now: float) -> bool:
        """Return whether no motor commands have arrived for `REPLY_TIMEOUT_S`.

        replies: number of motor commands so far.  now: wall time [s].
        """
        if replies != self._replies:
            self._replies, self._silent_s = replies, 0.0
        self._silent_s += min(now - self._updated, _LONGEST_WAIT_S)
        self._updated = now
        return self._silent_s >= REPLY_TIMEOUT_S


class _Server:
    """TCP server for the PX4 of one vehicle, with its connection and the state of its lockstep."""

    def __init__(self, row: int, vehicle: Mapping[str, Any], outputs: Sequence[HilOutput]) -> None:
        self.name, self.row = str(vehicle["name"]), row
        self.address: tuple[str, int] = vehicle["simulator"][0], int(vehicle["simulator"][1])
        names = [x.name for x in outputs if isinstance(x, HilMessage)]
        self.carried = frozenset(name for name in names if vehicle.get(name, False))
        self.core = SimulatorLink(
            len(vehicle["profile"]["rotors"]), outputs, sticks=bool(vehicle.get("sticks", False))
        )
        self.connection: socket.socket | None = None
        self.late_since: float | None = None
        self.unsent, self.next_late_sample = b"", 0.0
        self.was_connected = False
        self.lockstep = bool(vehicle.get("lockstep", False))
        self.silence = _Silence()
        self.guard = ConnectionGuard(self.name, self.address)

    @property
    def awaited(self) -> bool:
        """True while the world must wait for this PX4's reply to the last sensor sample."""
        return (
            self.connection is not None
            and self.late_since is None
            and self.core.in_step
            and self.core.unanswered > 0
        )

    @property
    def status(self) -> str:
        if self.connection is None:
            return "gone" if self.was_connected else "never connected"
        if self.late_since is not None:
            return "late"
        return "in step" if self.core.in_step else "running" if self.core.has_replied else "booting"


class Px4Links:
    """Connections to the PX4s of several vehicles in lockstep: sends sensor samples, receives motor commands.

    vehicles: configuration of the vehicles that fly PX4, with `simulator`: address to which PX4 connects;
        `sticks`: whether radio control is on; `lockstep`: whether its PX4 should run in lockstep; and one flag per sensor with a message
        of its own, such as `gps`
    origin: latitude, longitude [deg], altitude [m] of the arena, or None
    outputs: data that each simulated sensor adds to the simulator API
    """

    def __init__(
        self,
        vehicles: Sequence[Mapping[str, Any]],
        origin: tuple[float, float, float] | None,
        outputs: Sequence[HilOutput],
    ) -> None:
        self._origin = origin
        rotors = max((len(v["profile"]["rotors"]) for v in vehicles), default=4)
        self._motors = np.zeros((len(vehicles), rotors))
        self._servers = [_Server(i, v, outputs) for i, v in enumerate(vehicles)]
        carried = {name for s in self._servers for name in s.carried}
        self._messages = [x for x in outputs if isinstance(x, HilMessage) and x.name in carried]
        self._poll = select.poll()
        self._by_fd: dict[int, _Server] = {}
        self._events: list[str] = []
        self._begun = time.monotonic()
        self._missing_reported = False
        self._truth: Truth | None = None
        self._steps, self._sleep_s = 0, 2e-4

    @property
    def armed(self) -> NDArray[np.bool_]:
        """True for each vehicle that is armed (V,)."""
        return np.array([s.core.armed for s in self._servers], bool)

    @property
    def requested(self) -> tuple[str, ...]:
        """Names of the sensors, such as GPS, for which the next `begin` sends a separate message (HIL_GPS).

        The caller must sample these sensors before `begin`.
        """
        return tuple(x.name for x in self._messages if self._steps % x.every == 0)

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """Do nothing, because PX4 receives MAVLink by its own sockets, not through the world.

        The interface `AutopilotSet` requires this method.
        """

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Do nothing, because for vehicles with PX4 the router carries out the supervisor's requests.

        The interface `AutopilotSet` requires this method.
        """

    def sticks(self, vehicle: int, on: bool) -> None:
        """Switch a vehicle's simulated radio control on (with centred sticks) or off."""
        self._servers[vehicle].core.sticks = on

    def transmit(self) -> list[tuple[int, str, bytes]]:
        """Return an empty list, because PX4 sends MAVLink by its own sockets, not through the world.

        The interface `AutopilotSet` requires this method.
        """
        return []

    def receive_truth(self, truth: Truth) -> None:
        """Store the true states of the vehicles. They are sent to PX4 as ground truth for its log.

        truth: rows in the order of `vehicles`.
        """
        self._truth = truth

    def step(self, now: float, sensors: Mapping[str, Array]) -> Array:
        """Send sensor samples to all PX4s, wait for the replies, and return the motor commands 0..1 (V, R)."""
        self.begin(now, sensors)
        return self.finish()

    def begin(self, now: float, sensors: Mapping[str, Array]) -> None:
        """Send a sensor sample to each PX4, without waiting for the replies.

        now: time at the end of the sensor period [s]
        """
        self._accept()
        for server in self._servers:
            self._send(server, now, sensors)

    def finish(self) -> Array:
        """Wait for the replies of all PX4s in lockstep, and return the motor commands 0..1 (V, R).

        The next call overwrites the array.
        """
        self._collect()
        for server in self._servers:
            self._motors[server.row, : len(server.core.motors)] = server.core.motors
            if server.late_since is not None:  # a reply to an old sample does not count
                self._motors[server.row] = 0.0
            elif not server.core.in_step:
                self._stop_if_silent(server)
        return self._motors

    def _stop_if_silent(self, server: _Server) -> None:
        """Stop the motors of an autopilot without lockstep if it sends no motor commands any more."""
        core, silence = server.core, server.silence
        flies = server.connection is not None and core.armed
        if not flies or not silence.update(core.counts["answers"], time.monotonic()):
            silence.reported = False
            return
        self._motors[server.row] = 0.0
        if not silence.reported:
            silence.reported = True
            core.counts["late"] += 1
            self._events.append(
                f"{server.name}: PX4 has not replied for {REPLY_TIMEOUT_S:g} s: its motors stop until it sends motor commands again"
            )

    def events(self) -> list[str]:
        """Return the events since the last call, one line of text each, such as "uav1: PX4 connected"."""
        found, self._events = self._events, []
        for server in self._servers:
            found += server.guard.events
            server.guard.events.clear()
        return found

    def stats(self) -> dict[str, Any]:
        """Return {vehicle name: state of its PX4, armed flag, counts}, for the statistics of the process."""
        return {
            s.name: {"px4": s.status, "armed": s.core.armed, **s.core.counts, **s.guard.counts}
            for s in self._servers
        }

    def close(self) -> None:
        """Close all sockets of the simulator ports."""
        for server in self._servers:
            server.guard.close()
            if server.connection is not None:
                server.connection.close()

    # -- connections -------------------------------------------------------------------------------------------------

    def _accept(self) -> None:
        """Accept the TCP connections of PX4s that have started or restarted.

        The port of a vehicle without a PX4 is checked at every step, the other ports less often.
        """
        self._steps += 1
        every = self._steps % _ACCEPT_EVERY == 0
        due = [s for s in self._servers if every or s.connection is None]
        if not due:
            return
        now = time.monotonic()
        for server in due:
            found = server.guard.accept(now, taken=server.connection is not None)
            if found is not None:
                self._connect(server, *found)
        self._report_missing()

    def _connect(self, server: _Server, connection: socket.socket, data: bytes) -> None:
        server.connection, server.late_since = connection, None
        server.core.reset()
        self._by_fd[connection.fileno()] = server
        self._poll.register(connection, select.POLLIN)
        self._events.append(f"{server.name}: PX4 connected" + (" again" if server.was_connected else ""))
        server.was_connected = True
        server.core.receive(data)

    def _report_missing(self) -> None:
        missing = [s for s in self._servers if not s.was_connected]
        if missing and not self._missing_reported and time.monotonic() - self._begun > _CONNECT_TIMEOUT_S:
            self._missing_reported = True
            ports = ", ".join(f"{s.name} ({s.address[0]}:{s.address[1]})" for s in missing)
            self._events.append(
                f"PX4 has not connected to the simulator port after {_CONNECT_TIMEOUT_S:g} s: {ports}. Its log says why"
            )

    def _disconnect(self, server: _Server, why: str) -> None:
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

    # -- one step ----------------------------------------------------------------------------------------------------

    def _send(self, server: _Server, now: float, sensors: Mapping[str, Array]) -> None:
        """Send a sensor sample to the PX4 of one vehicle.

        A late PX4 still gets samples, because PX4 runs only when a sample arrives. The samples are sent at most in real time.
        Otherwise a slow PX4 could never catch up, because the world does not wait for a late PX4.
        """
        if server.late_since is not None:
            self._read(server)  # its replies since the last step: after a new sample it would be late again
        if server.connection is None:
            return
        if server.late_since is not None:
            wall = time.monotonic()
            if wall < server.next_late_sample:
                return
            server.next_late_sample = wall + _LATE_SAMPLE_S
        if server.unsent:
            return self._put(server, server.unsent)  # PX4 does not read, so the new sample is dropped
        data = server.core.sample(now, sensors, server.row)
        if server.carried:
            data += server.core.messages(now, sensors, server.row, server.carried)
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
            return self._disconnect(server, "has closed the simulator link")
        if server.unsent and server.late_since is None:
            self._set_late(server, "does not read the sensor data", time.monotonic())

    def _collect(self) -> None:
        """Wait until all PX4s in lockstep have replied, or until the timeout.

        Then report each PX4 without a reply as late. A pause counts as `_LONGEST_WAIT_S` at most, because the
        whole computer may have stood still.
        """
        began = since = time.monotonic()
        waited_s = 0.0
        self._sleep_for_most()
        while True:
            awaited = [s for s in self._servers if s.awaited]
            left_s = max(0.0, REPLY_TIMEOUT_S - waited_s)
            for fd, _ in self._poll.poll(1e3 * min(left_s, 0.5 * _LONGEST_WAIT_S) if awaited else 0):
                self._read(self._by_fd[fd])
            if not awaited or not any(s.awaited for s in awaited):
                return
            now = time.monotonic()
            waited_s, since = waited_s + min(now - since, _LONGEST_WAIT_S), now
            if left_s <= 0.0:
                for server in awaited:
                    if server.awaited:
                        self._set_late(server, f"has not replied for {REPLY_TIMEOUT_S:g} s", began)
                return

    def _sleep_for_most(self) -> None:
        """Sleep once until most PX4s have probably replied, and read their replies.

        Do nothing if few replies are awaited. With many vehicles, waking up for each reply would cost more
        CPU time. Each step adjusts the duration of the sleep.
        """
        awaited = [s for s in self._servers if s.awaited]
        if len(awaited) < _SLEEP_FROM:
            return
        time.sleep(self._sleep_s)
        for fd, _ in self._poll.poll(0):
            self._read(self._by_fd[fd])
        missing = sum(s.awaited for s in awaited)
        longer = missing > len(awaited) // 4
        self._sleep_s = min(self._sleep_s + _SLEEP_STEP_S, _MAX_SLEEP_S) if longer else self._sleep_s * 0.98

    def _read(self, server: _Server) -> None:
        assert server.connection is not None
        try:
            data = server.connection.recv(_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            return self._disconnect(server, "has closed the simulator link")
        server.core.receive(data)
        if server.lockstep and server.core.has_replied and not server.core.in_step:
            server.lockstep = False  # reported once
            self._events.append(
                f"{server.name}: this PX4 does not run in lockstep, so it flies by its own clock: build px4_sitl_default"
            )
        if server.late_since is not None and server.core.unanswered == 0:
            silent = time.monotonic() - server.late_since
            server.late_since = None
            self._events.append(f"{server.name}: PX4 replies again after {silent:.1f} s")

    def _set_late(self, server: _Server, why: str, since: float) -> None:
        server.late_since = since
        server.core.motors[:] = 0.0
        what = "it is paused by SIGSTOP or overloaded; its motors stop until it replies, the world goes on"
        server.core.counts["late"] += server.core.armed
        if not server.core.armed:  # for example disarmed in OFFBOARD, waiting for setpoints
            what = "it is disarmed; the world goes on without waiting for it"
        self._events.append(f"{server.name}: PX4 {why}: {what}")
