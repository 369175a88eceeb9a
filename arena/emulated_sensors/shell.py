"""Sockets and loop of the process `sensors`.

The process must never send data to a vehicle.

One UDP socket sends the measurements to the router and receives telemetry from the router's tools ports.
"""

from __future__ import annotations

import contextlib
import selectors
import time
from collections.abc import Mapping
from typing import Any

from arena.clock import SimTime, WallClock
from arena.emulated_sensors.core import EmulatedSensors
from arena.emulated_sensors.settings import Settings
from arena.errors import ArenaError
from arena.mocap.client import CapturedFrame, ChangeReport, open_client
from arena.process_context import ProcessContext
from arena.transport import listen_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import SENSORS_PING
from arena.wire.router_ping import PING_PERIOD_S, ping_router

_WAIT_S = 0.01
"""Longest sleep, in wall time [s]: a sensor can be due although nothing arrives."""
_MAX_DATAGRAMS = 2000  # in one cycle: a flood must not stop the sensors
_REPORT_PERIOD_S = 1.0


class SensorsShell:
    """Sockets and main loop of the process `sensors`, which emulates relative sensors."""

    def __init__(self, process: ProcessContext) -> None:
        s = process.settings
        self._process = process
        self._clock = SimTime(s["clock"]) if s["clock"] else WallClock()
        self._core = EmulatedSensors(Settings.of(s))
        self._codec = Codec(SENSORS_PING.system, SENSORS_PING.component)
        self._socket = listen_udp((str(s["listen"][0]), int(s["listen"][1])), "the emulated sensors")
        self._captures = [_Capture(process, raw) for raw in s["captures"]]
        vehicles = self._core.settings.vehicles
        self._row_of = {v.tools: row for row, v in enumerate(vehicles) if v.estimated}
        self._routers = [v.router for v in vehicles]
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._socket, selectors.EVENT_READ)
        for capture in self._captures:
            if (descriptor := capture.fileno()) >= 0:
                self._selector.register(descriptor, selectors.EVENT_READ)
        self._next_ping = self._next_report = float("-inf")

    def run(self) -> None:
        """Measure and send until a stop signal arrives."""
        while not self._process.stopping:
            self._selector.select(_WAIT_S)
            self.turn(self._clock.now(), time.monotonic())

    def turn(self, now: float, wall: float) -> None:
        """Receive all waiting datagrams and frames, and send all measurements that are due.

        now: time of the arena [s].  wall: monotonic time [s].
        """
        for capture in self._captures:
            for frame in capture.poll(now):
                self._core.on_frame(frame, capture.simulated, now)
        self._read_socket(now)
        for row, data in self._core.step(now):
            if (router := self._routers[row]) is not None:
                self._send(data, router)
        if wall >= self._next_ping:
            self._next_ping = wall + PING_PERIOD_S
            for address in self._row_of:
                self._send(self._codec.pack(ping_router()), address)
        if wall >= self._next_report:
            self._next_report = wall + _REPORT_PERIOD_S
            self._process.stats(self._core.stats())
            for capture in self._captures:
                capture.report()

    def close(self) -> None:
        self._selector.close()
        self._socket.close()
        for capture in self._captures:
            capture.close()

    def _read_socket(self, now: float) -> None:
        for _ in range(_MAX_DATAGRAMS):
            try:
                data, sender = self._socket.recvfrom(65535)
            except OSError:
                return
            if (row := self._row_of.get(sender)) is not None:
                self._core.on_datagram(row, data, now)

    def _send(self, data: bytes, to: tuple[str, int]) -> None:
        with contextlib.suppress(OSError):  # a full queue or no router: the next measurement is newer
            self._socket.sendto(data, to)


class _Capture:
    """Client of one motion-capture server.

    raw: settings of the client; `simulated` is true for the motion capture emulator
    """

    def __init__(self, process: ProcessContext, raw: Mapping[str, Any]) -> None:
        settings = {key: value for key, value in raw.items() if key != "simulated"}
        self.simulated = bool(raw["simulated"])
        self._process, self._client, self._report = process, open_client(settings), ChangeReport()

    def fileno(self) -> int:
        """Return a file descriptor that is readable when a frame has arrived; -1 without a socket."""
        return self._client.fileno()

    def poll(self, now: float) -> list[CapturedFrame]:
        """Return the captured frames that have arrived.

        The list is empty while there is no network. now: time of the arena [s].
        """
        try:
            return self._client.poll(now)
        except (ArenaError, OSError):
            return []

    def report(self) -> None:
        """Report to the supervisor why no poses arrive.

        Nothing is reported until the reason changes.
        """
        if (change := self._report.changed(self._client.diagnosis())) is not None:
            self._process.event(f"sensors: {change}")

    def close(self) -> None:
        self._client.close()
