"""`python -m arena.copilot slice.json`: the copilot's socket, its receivers of motion capture, and its clock.

One UDP socket hears and says everything: what the routers' tools ports send is known by its sender, and programs beat there. On
the simulation clock fifty looks a second of simulated time gate the world; where hardware flies they are the wall's.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from typing import Any

from arena.clock import Clock, SimClock, WallClock
from arena.copilot.copilot import STEP_HZ, Copilot, Output
from arena.copilot.settings import Rules, Vehicle
from arena.errors import ArenaError
from arena.mocap.client import ChangeReport, MocapClient, open_client
from arena.process_context import ProcessContext, ShutdownPolicy, run_room
from arena.transport import listen_udp

_BUFFER_BYTES = 1 << 22
_MOST = 20_000  # datagrams at a look: a flood must not keep us from judging
_LOOK_S = 0.5
_PATIENCE_WALL_S = 0.2
_PATIENCE_S = 10.0


class _Pace:
    """Absolute deadlines, STEP_HZ of them a second; missed ones are skipped."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._due = clock.now()
        self._asked = False

    def wait(self, patience_s: float) -> float | None:
        """The time [s] at the next deadline; None when the simulation's time has not come to it in patience_s of the wall's."""
        if not isinstance(self._clock, SimClock):
            now = self._clock.sleep_until(self._due)
        else:
            if not self._asked:
                self._clock.request_wake(self._due)
                self._asked = True
            told = self._clock.wait_for_wake(patience_s)
            if told is None:
                return None
            self._asked, now = False, told
        self._due = max(self._due + 1.0 / STEP_HZ, now)
        return now


class Shell:
    def __init__(self, room: ProcessContext) -> None:
        s = room.settings
        self._room = room
        self._clock: Clock = SimClock(s["clock"], room.name) if s.get("clock") else WallClock()
        vehicles = [Vehicle.of(row) for row in s["vehicles"]]
        self._pace = _Pace(self._clock)
        self._core = Copilot(Rules.of(s), vehicles, self._clock.now())
        self._socket = listen_udp(
            (s["listen"][0], int(s["listen"][1])), "the copilot", receive_buffer_bytes=_BUFFER_BYTES
        )
        self._rows = {v.tools: i for i, v in enumerate(vehicles)}
        self._captures: list[MocapClient] = [open_client(c) for c in s["captures"]]
        self._reports = [ChangeReport() for _ in self._captures]
        self._afterlives = [(kind, ShutdownPolicy(limit_s=60.0 if kind else None)) for kind in (True, False)]
        self._began = self._looked = time.monotonic()
        self._beat = -1e9
        self._ready = False
        self._spent_s, self._steps, self._longest_s = 0.0, 0, 0.0

    def run(self) -> None:
        """Until told to stop; without a supervisor, until the vehicles are disarmed. Where time stands still, before a PX4 has
        booted or behind a world that is stopped, we listen all the same, and tell how we are.
        """
        while not self._room.stopping:
            now = self._pace.wait(_PATIENCE_WALL_S)
            began = time.thread_time()
            self._listen(self._clock.now() if now is None else now)
            if now is not None:
                self._do(self._core.step(now))
                self._count(time.thread_time() - began)
            if time.monotonic() - self._looked >= _LOOK_S and self._look():
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

    def _listen(self, now: float) -> None:
        self._hear(now)
        for capture in self._captures:
            with contextlib.suppress(OSError, ArenaError):  # a network that is away: the poses' age tells
                self._core.see(capture.poll(now), now)
        wall = time.monotonic()
        if wall - self._beat >= 1.0:  # routers forget by the wall's time
            self._beat = wall
            for vehicle in self._core.vehicles:
                self._send(self._core.heartbeat(), vehicle.tools)

    def _do(self, output: Output) -> None:
        for row, frames in output.frames:
            vehicle = self._core.vehicles[row]
            for frame in frames:
                self._send(frame, vehicle.panic)
                self._send(frame, vehicle.tools)
        for event in output.events:
            self._room.event(event)
            print(event, flush=True)

    def _hear(self, now: float) -> None:
        for _ in range(_MOST):
            try:
                data, sender = self._socket.recvfrom(65535)
            except OSError:
                return
            self._core.hear(self._rows.get(sender), data, now)

    def _send(self, data: bytes, to: tuple[str, int]) -> None:
        with contextlib.suppress(OSError):  # a network that is away now may be back at the next try
            self._socket.sendto(data, to)

    def _look(self) -> bool:
        """Twice a second of wall time. True when there is nothing left to watch."""
        self._looked = wall = time.monotonic()
        if not self._ready and (not self._core.unheard or wall - self._began > _PATIENCE_S):
            self._ready = True
            if self._core.unheard:
                self._room.event(
                    f"{', '.join(self._core.unheard)} not heard or not captured after {_PATIENCE_S:g} s"
                )
            self._room.ready()
        self._room.stats(self._stats())
        for capture, report in zip(self._captures, self._reports, strict=True):
            if (news := report.changed(capture.diagnosis())) is not None:
                self._room.event(news)
        orphaned = self._room.orphaned
        over = [
            a.over(orphaned=orphaned, any_armed=self._core.any_armed(simulated=s), now=wall)
            for s, a in self._afterlives
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
    return run_room("arena:copilot", _make, argv)


def _make(room: ProcessContext) -> Callable[[], None]:
    shell = Shell(room)

    def serve() -> None:
        try:
            shell.run()
        finally:
            shell.close()

    return serve


if __name__ == "__main__":
    sys.exit(main())
