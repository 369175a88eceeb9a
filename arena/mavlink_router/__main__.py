"""`python -m arena.mavlink_router slice.json`: the router's sockets and clock."""

from __future__ import annotations

import contextlib
import select
import sys
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.clock import SimTime
from arena.errors import RunError
from arena.mavlink_router.fault_injection import RouterFaults
from arena.mavlink_router.router import Out, Router
from arena.mavlink_router.routing_table import Table
from arena.process_context import ProcessContext, ShutdownPolicy, run_room
from arena.transport import listen_udp

SYSTEM, COMPONENT = 254, 190
_DATAGRAM_BYTES = 1 << 16
_TICK_S, _SECOND_S = 0.25, 1.0
_PATIENCE_S = 10.0  # a simulated vehicle not heard for so long no longer keeps the others on the ground


class Shell:
    """Owns the sockets. One datagram of each waiting socket is taken in turn, so that a flood on one starves no other."""

    def __init__(self, room: ProcessContext, table: Table) -> None:
        self._room, self._router = room, Router(table)
        self._sockets = [listen_udp(address, "the router") for address in self._router.sockets]
        self._sendto = [s.sendto for s in self._sockets]
        self._receive = {s.fileno(): s.recvfrom_into for s in self._sockets}
        self._key = {s.fileno(): key for key, s in enumerate(self._sockets)}
        self._poll = select.epoll()
        for fd in self._key:
            self._poll.register(fd, select.EPOLLIN)
        self._spoiling = RouterFaults(room, self._router, self._poll, self._tick_at)
        self._buffer = memoryview(bytearray(_DATAGRAM_BYTES))
        self._voice = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        # Simulated vehicles may fall silent with their world; real ones are served until they are disarmed.
        mixed = not all(v.simulated for v in table.vehicles)
        limit_s = 60.0 if table.simulated or mixed else None
        self._afterlives = [(True, ShutdownPolicy(limit_s=limit_s)), (False, ShutdownPolicy(limit_s=None))]
        self._began = self._next_tick = self._next_second = time.monotonic()
        self._time, self._next_beat = _world_time(room.settings.get("clock")), 0.0
        self._ready = False
        self._over = False

    def run(self) -> None:
        """Until told to stop, or until the afterlife is over."""
        while not (self._room.stopping or self._over):
            self.turn(max(0.0, self._next_tick - time.monotonic()))
        self._room.stats(self._stats())

    def turn(self, patience_s: float) -> None:
        """Wait so long for datagrams, and do all that is due."""
        for fd, _ in self._poll.poll(patience_s):
            self._take(fd)
        if news := self._router.news():
            self._room.facts(news)
        for warning in self._router.warnings():
            self._room.event(warning)
        now = time.monotonic()
        if self._time is not None and self._time.now() >= self._next_beat:
            self._beat(now)
        if now >= self._next_tick:
            self._tick(now)

    def close(self) -> None:
        self._spoiling.close()
        self._poll.close()
        for s in self._sockets:
            s.close()

    def _take(self, fd: int) -> None:
        receive = self._receive.get(fd)
        if receive is None:
            return self._send(self._spoiling.look(time.monotonic()))
        try:
            size, sender = receive(self._buffer)
        except OSError:  # nothing there after all
            return
        self._send(self._spoiling.on_datagram(self._key[fd], sender, self._buffer[:size], time.monotonic()))

    def _send(self, out: list[Out]) -> None:
        counts = self._router.counts
        for data, destinations in out:
            for key, dest in destinations:
                try:
                    counts.bytes_out += self._sendto[key](data, dest)
                except OSError:  # a full queue or a network that is away: the next message will be newer
                    counts.dropped["not sent"] += 1

    def _tick_at(self, when: float) -> None:
        """No later than then, monotonic [s]."""
        self._next_tick = min(self._next_tick, when)

    def _tick(self, now: float) -> None:
        self._next_tick = max(self._next_tick + _TICK_S, now)
        self._send(self._spoiling.look(now))
        self._router.tick(now)
        orphaned = self._room.orphaned
        self._over = self._is_over(orphaned, now)
        if not self._ready and (self._router.all_heard or now - self._began > _PATIENCE_S):
            self._ready = True
            if silent := self._router.silent:
                self._room.event(
                    f"{', '.join(silent)} not heard for {_PATIENCE_S:g} s: the others need not wait"
                )
            self._room.ready()
        if now >= self._next_second:
            self._next_second = max(self._next_second + _SECOND_S, now)
            self._beat(now)
            self._room.stats(self._stats())

    def _beat(self, now: float) -> None:
        """Once a second, by the wall's clock and by the world's: whichever is faster, no autopilot misses its ground station."""
        if self._time is not None:
            self._next_beat = self._time.now() + _SECOND_S
        if self._router.table.heartbeat and (not self._room.orphaned or self._router.gcs_alive(now)):
            self._send(self._spoiling.heartbeat(self._heartbeat(), now))

    def _is_over(self, orphaned: bool, now: float) -> bool:
        over = [
            a.over(orphaned=orphaned, any_armed=self._router.any_armed(simulated=s), now=now)
            for s, a in self._afterlives
        ]
        return all(over)

    def _heartbeat(self) -> bytes:
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        packed: bytes = beat.pack(self._voice)
        self._voice.seq = (self._voice.seq + 1) % 256
        return packed

    def _stats(self) -> dict[str, Any]:
        counts = self._router.counts
        dropped = {why: n for why, n in counts.dropped.items() if n}
        return {**vars(counts), "dropped": dropped, "telemetry": self._router.telemetry()}


def _world_time(path: str | None) -> SimTime | None:
    """None without a world: then the wall's time is all there is."""
    if path is not None:
        with contextlib.suppress(RunError):
            return SimTime(path)
    return None


def main(argv: list[str] | None = None) -> int:
    return run_room("arena:router", _make, argv)


def _make(room: ProcessContext) -> Callable[[], None]:
    shell = Shell(room, Table.from_slice(room.settings))

    def serve() -> None:
        try:
            shell.run()
        finally:
            shell.close()

    return serve


if __name__ == "__main__":
    sys.exit(main())
