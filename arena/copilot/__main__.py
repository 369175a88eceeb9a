"""Process of the copilot, with its sockets, its motion-capture clients and its clock.

Run as `python -m arena.copilot slice.json`. One UDP socket sends and receives everything. Telemetry comes
from the router's tools port and is recognised by this sender; user programs send their heartbeats to the same
socket. In simulation the copilot makes 50 steps per simulated second, and the world waits for each step. With
hardware the copilot runs on wall time.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from typing import Any

from arena.clock import Clock, SimClock, WallClock
from arena.copilot.copilot import Copilot, Output
from arena.copilot.settings import STEP_HZ, Rules, Vehicle
from arena.errors import ArenaError
from arena.mocap.client import ChangeReport, MocapClient, open_client
from arena.process_context import ProcessContext, ShutdownPolicy, run_and_close, run_process
from arena.transport import listen_udp

_BUFFER_BYTES = 1 << 22
_MAX_DATAGRAMS = 20_000  # per step: a flood must not delay the rules
_REPORT_PERIOD_S = 0.5
_STEP_TIMEOUT_S = 0.2
_READY_TIMEOUT_S = 10.0


class _StepTimer:
    """Timer that triggers the rule checks of the copilot at a fixed rate (STEP_HZ).

    Deadlines are absolute. Missed deadlines are skipped.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._due = clock.now()
        self._requested = False

    def wait(self, timeout_s: float) -> float | None:
        """Wait until the next rule check of the copilot is due, and return the time [s]; None after a timeout.

        timeout_s: limit of wall time [s]
        """
        if not isinstance(self._clock, SimClock):
            now = self._clock.sleep_until(self._due)
        else:
            if not self._requested:
                self._clock.request_wake(self._due)
                self._requested = True
            woken = self._clock.wait_for_wake(timeout_s)
            if woken is None:
                return None
            self._requested, now = False, woken
        self._due = max(self._due + 1.0 / STEP_HZ, now)
        return now


class CopilotProcess:
    """Process of the copilot: opens the sockets and runs the loop."""

    def __init__(self, room: ProcessContext) -> None:
        s = room.settings
        self._room = room
        self._clock: Clock = SimClock(s["clock"], room.name) if s.get("clock") else WallClock()
        vehicles = [Vehicle.of(row) for row in s["vehicles"]]
        self._timer = _StepTimer(self._clock)
        self._core = Copilot(Rules.of(s), vehicles, self._clock.now())
        self._socket = listen_udp(
            (s["listen"][0], int(s["listen"][1])), "the copilot", receive_buffer_bytes=_BUFFER_BYTES
        )
        self._rows = {v.tools: i for i, v in enumerate(vehicles)}
        self._captures: list[MocapClient] = [open_client(c) for c in s["captures"]]
        self._reports = [ChangeReport() for _ in self._captures]
        self._shutdowns = [(kind, ShutdownPolicy(limit_s=60.0 if kind else None)) for kind in (True, False)]
        self._began = self._reported = time.monotonic()
        self._heartbeat_at = -1e9
        self._ready = False
        self._spent_s, self._steps, self._longest_s = 0.0, 0, 0.0

    def run(self) -> None:
        """Run the copilot until a stop signal. If the supervisor dies, first wait until all vehicles are disarmed.

        Simulation time stands still before PX4 has booted and when the world has stopped. Meanwhile the
        copilot receives telemetry and sends stats.
        """
        while not self._room.stopping:
            now = self._timer.wait(_STEP_TIMEOUT_S)
            began = time.thread_time()
            self._receive(self._clock.now() if now is None else now)
            if now is not None:
                self._send_output(self._core.step(now))
                self._count(time.thread_time() - began)
            if time.monotonic() - self._reported >= _REPORT_PERIOD_S and self._report():
                return

    def close(self) -> None:
        self._room.stats(self._stats())
        self._socket.close()
        for capture in self._captures:
            capture.close()

    def _count(self, spent_s: float) -> None:
        self._spent_s, self._steps, self._longest_s = (
            self._spent_s + spent_s,
            self._steps + 1,
            max(self._longest_s, spent_s),
        )

    def _receive(self, now: float) -> None:
        self._read_socket(now)
        for server, capture in enumerate(self._captures):
            with contextlib.suppress(OSError, ArenaError):  # no network: the rule `pose_age` reports it
                self._core.on_frames(capture.poll(now), now, server)
        wall = time.monotonic()
        if wall - self._heartbeat_at >= 1.0:  # routers drop silent clients by wall time
            self._heartbeat_at = wall
            for vehicle in self._core.vehicles:
                self._send(self._core.heartbeat(), vehicle.tools)

    def _send_output(self, output: Output) -> None:
        for row, frames in output.frames:
            vehicle = self._core.vehicles[row]
            for frame in frames:
                self._send(frame, vehicle.panic)
                self._send(frame, vehicle.tools)
        for row, frames in output.renewals:
            for frame in frames:
                self._send(frame, self._core.vehicles[row].tools)
        for event in output.events:
            self._room.event(event)
            print(event, flush=True)

    def _read_socket(self, now: float) -> None:
        for _ in range(_MAX_DATAGRAMS):
            try:
                data, sender = self._socket.recvfrom(65535)
            except OSError:
                return
            self._core.on_datagram(self._rows.get(sender), data, now)

    def _send(self, data: bytes, to: tuple[str, int]) -> None:
        with contextlib.suppress(OSError):  # no network now: the next try may succeed
            self._socket.sendto(data, to)

    def _report(self) -> bool:
        """Send the copilot's statistics to the supervisor. Return whether the copilot process may end.

        Also reports, once, that the copilot is ready.

        Called twice a second of wall time. `ShutdownPolicy` decides when the process may end.
        """
        self._reported = wall = time.monotonic()
        if not self._ready and (not self._core.missing or wall - self._began > _READY_TIMEOUT_S):
            self._ready = True
            if self._core.missing:
                self._room.event(
                    f"{', '.join(self._core.missing)}: no heartbeat or no captured pose within {_READY_TIMEOUT_S:g} s; "
                    "the start of the arena continues"
                )
            self._room.ready()
        self._room.stats(self._stats())
        for capture, report in zip(self._captures, self._reports, strict=True):
            if (change := report.changed(capture.diagnosis())) is not None:
                self._room.event(change)
        orphaned = self._room.orphaned
        over = [
            a.over(orphaned=orphaned, any_armed=self._core.any_armed(simulated=s), now=wall)
            for s, a in self._shutdowns
        ]
        return all(over)

    def _stats(self) -> dict[str, Any]:
        mean = 1e3 * self._spent_s / max(self._steps, 1)
        return {
            **self._core.stats(),
            "step_ms": round(mean, 3),
            "step_most_ms": round(1e3 * self._longest_s, 2),
        }


def main(argv: list[str] | None = None) -> int:
    return run_process("arena:copilot", _make, argv)


def _make(room: ProcessContext) -> Callable[[], None]:
    return run_and_close(CopilotProcess(room))


if __name__ == "__main__":
    sys.exit(main())
