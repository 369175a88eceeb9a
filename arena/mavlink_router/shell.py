"""The router process: its sockets and its loop. The process also sends the heartbeat of a ground station."""

from __future__ import annotations

import contextlib
import math
import select
import time
from typing import TYPE_CHECKING, Any

from arena.clock import SimTime
from arena.errors import RunError
from arena.kernels import INTERPRETED
from arena.mavlink_router.backlog import Backlog
from arena.mavlink_router.endpoints import Out
from arena.mavlink_router.ground_station import GroundStation
from arena.mavlink_router.loopback_sending import send_unfragmented
from arena.mavlink_router.reports import report_changes, report_ready
from arena.mavlink_router.router import Router
from arena.mavlink_router.routing_table import Table
from arena.process_context import OPERATOR_TIMEOUT_S, SUPERVISOR_LOST, ProcessContext, ShutdownPolicy
from arena.transport import MAX_DATAGRAM_BYTES, Address, listen_udp

if TYPE_CHECKING:
    from arena.kernels.datagram_loop import DatagramLoop

_MAX_OLD_DATAGRAMS = 16  # largest number of datagrams read from one socket per cycle after a stall
_TICK_S, _SECOND_S = 0.25, 1.0


class RouterShell:
    """The router process: opens the sockets of a `Router`, and receives and sends datagrams in a loop.

    Each cycle reads one datagram from each socket that has some, or a few if the kernels are compiled, so that a flood on
    one socket does not delay the others.
    """

    def __init__(self, process: ProcessContext, table: Table) -> None:
        self._world_time, self._next_heartbeat = _world_time(process.settings.get("clock")), 0.0
        sim_now = self._world_time.now if self._world_time is not None else None
        self._process, self._router = process, Router(table, sim_now)
        self._sockets = [listen_udp(address, "the router") for address in self._router.sockets]
        send_unfragmented(self._sockets)
        self._sendto = [s.sendto for s in self._sockets]
        self._receive = {s.fileno(): (s.recvfrom_into, key) for key, s in enumerate(self._sockets)}
        self._poll = select.epoll()
        for fd in self._receive:
            self._poll.register(fd, select.EPOLLIN)
        self._route = self._router.on_datagram
        self._buffer = memoryview(bytearray(MAX_DATAGRAM_BYTES))
        self._station = GroundStation()
        # Without a supervisor, simulated vehicles are served for 60 s at most; real ones until they are disarmed.
        mixed = not all(v.simulated for v in table.vehicles)
        limit_s = 60.0 if table.simulated or mixed else None
        self._shutdown = [(True, ShutdownPolicy(limit_s=limit_s)), (False, ShutdownPolicy(limit_s=None))]
        self._began = self._next_tick = self._next_second = time.monotonic()
        all_simulated = all(v.simulated for v in table.vehicles)
        self._world_s = self._world_time.page if self._world_time is not None else None
        self._backlog = Backlog(
            self._sockets,
            {*self._router.links.values(), *self._router.ground_links.values()},
            self._world_s if all_simulated else None,
        )
        self._loop = None if INTERPRETED else self._make_loop()
        self._ready = False
        self._operator = True
        self._over = False
        self._in_loop = True  # a derived class may route datagrams in another way for some time

    def run(self) -> None:
        """Route datagrams until the process must end.

        If a stop is requested, the process ends as soon as no real vehicle is armed. If the supervisor dies, the process ends
        when all vehicles are disarmed; it waits 60 s at most for simulated vehicles.
        """
        process, router = self._process, self._router
        self._take_requests(
            time.monotonic()
        )  # of the time before a restart, before the first command is forwarded
        while not (self._over or (process.stopping and process.may_end(router.armed(simulated=False)))):
            self.turn(max(0.0, self._next_tick - time.monotonic()))
        self._process.stats(self._stats())

    def turn(self, timeout_s: float) -> None:
        """Run one cycle of the router: wait for datagrams, route them, and do the periodic work that is due.

        timeout_s: longest time to wait [s].
        """
        if self._loop is not None and self._in_loop:
            self._run_loop(self._loop, timeout_s)
        else:
            if self._loop is not None:
                self._loop.stop_timer()
            self._backlog.waits.before_poll(time.monotonic())
            for fd, _ in self._poll.poll(timeout_s):
                if fd in self._receive:
                    self._read(fd)
                else:
                    self._on_other_event(fd)
        report_changes(self._process, self._router)
        now = time.monotonic()
        if self._world_time is not None and self._world_time.now() >= self._next_heartbeat:
            self._heartbeat(now)
        if now >= self._next_tick:
            self._tick(now)

    def close(self) -> None:
        self._poll.close()
        for s in self._sockets:
            s.close()

    def _make_loop(self) -> DatagramLoop:
        """Create the compiled loop that receives datagrams and routes ordinary ones (telemetry, setpoints).

        For all other datagrams, the loop calls methods of this object.
        """
        from arena.kernels.datagram_loop import DatagramLoop

        return DatagramLoop(
            self._router.shortcut.ordinary,
            self._backlog.waits,
            self._poll.fileno(),
            [s.fileno() for s in self._sockets],
            self._on_other_datagram,
            self._on_late_datagram,
            self._on_event,
        )

    def _run_loop(self, loop: DatagramLoop, timeout_s: float) -> None:
        until, counts = time.monotonic() + timeout_s, self._router.counts
        world_until = math.inf if self._world_s is None else self._next_heartbeat
        loop.run(until, self._backlog.waits.world_s if self._world_s is None else self._world_s, world_until)
        counts.bytes_out += loop.bytes_out
        if loop.unsent:
            counts.dropped["not sent"] += loop.unsent
        loop.bytes_out = loop.unsent = 0

    def _on_other_datagram(self, key: int, sender: Address, data: memoryview, now: float) -> None:
        """Route a datagram that the compiled loop does not route itself, such as a command."""
        self._send(self._router.on_other_datagram(key, sender, data, now))

    def _on_late_datagram(self, key: int, sender: Address, data: memoryview, now: float) -> None:
        """Route a datagram whose frames may be too old, because the process was stalled before it read them."""
        self._send(self._route(key, sender, self._backlog.young(key, data, now), now))

    def _on_event(self, fd: int) -> None:
        """Read a socket or file descriptor that the compiled loop has reported but does not read itself.

        This is a socket whose datagrams may be too old, or a file descriptor of a derived class.
        """
        if fd in self._receive:
            self._read_old(fd, time.monotonic())
        else:
            self._on_other_event(fd)

    def _on_other_event(self, fd: int) -> None:
        """Read a file descriptor that a derived class polls, such as the socket for injected faults."""

    def _read(self, fd: int) -> None:
        now = time.monotonic()
        receive, key = self._receive[fd]
        if self._backlog.waits.may_be_old(key, now):
            self._read_old(fd, now)
            return
        with contextlib.suppress(OSError):  # no datagram after all
            size, sender = receive(self._buffer)
            self._send(self._route(key, sender, self._buffer[:size], now))

    def _read_old(self, fd: int, now: float) -> None:
        """Read and route several datagrams that have waited in a socket and may be too old.

        Many datagrams wait after a stall of the process.
        """
        _, key = self._receive[fd]
        with contextlib.suppress(OSError):  # no more datagrams
            for _ in range(_MAX_OLD_DATAGRAMS):
                data, sender = self._backlog.receive(key)
                self._send(self._route(key, sender, data, now))

    def _send(self, out: list[Out]) -> None:
        counts = self._router.counts
        for data, destinations in out:
            for key, dest in destinations:
                try:
                    counts.bytes_out += self._sendto[key](data, dest)
                except OSError:  # full queue or no network: the next message is newer
                    counts.dropped["not sent"] += 1

    def _take_requests(self, now: float) -> None:
        for request in self._process.requests():
            self._router.commands.on_request(request, now)
            self._process.confirm(request)

    def _tick(self, now: float) -> None:
        self._next_tick = max(self._next_tick + _TICK_S, now)
        self._router.tick(now)
        self._take_requests(now)
        self._process.audit(self._router.commands.take_audit())
        self._backlog.tick(now)
        orphaned = self._process.orphaned
        if orphaned:
            self._router.commands.on_request(SUPERVISOR_LOST, now)
        self._over = self._is_over(orphaned, now)
        self._ready = self._ready or report_ready(self._process, self._router, now - self._began)
        if now >= self._next_second:
            self._next_second = max(self._next_second + _SECOND_S, now)
            self._heartbeat(now)
            self._process.stats(self._stats())

    def _heartbeat(self, now: float) -> None:
        """Send the heartbeat of a ground station to the vehicles that may receive it now.

        Called once a second of wall time and, in addition, once a second of simulation time, because an autopilot in a world
        that runs faster than real time would miss heartbeats. Real vehicles with a data-link
        failsafe receive it only while an operator is present, because it would disable this failsafe.
        """
        if self._world_time is not None:
            self._next_heartbeat = self._world_time.now() + _SECOND_S
        station = self._router.gcs_alive(now)
        if self._router.table.heartbeat and (station or not self._process.orphaned):
            operator = station or self._process.operator_present(now)
            self._report_operator(operator, now)
            self._send_heartbeat(self._router.heartbeat(self._station.heartbeat(), operator=operator), now)

    def _report_operator(self, operator: bool, now: float) -> None:
        """Report an event when the arena's operator (terminal or ground station) disappears or returns.

        Nothing is logged if no vehicle needs an operator (receives heartbeats only while an operator is present).
        """
        names = ", ".join(v.name for v in self._router.table.vehicles if v.needs_operator)
        if not names or operator == self._operator or now - self._began < OPERATOR_TIMEOUT_S:
            return
        self._operator = operator
        if operator:
            self._process.event(
                f"an operator is present: the router sends the heartbeat of a ground station to {names}"
            )
        else:
            self._process.event(
                f"no operator: {names} receives no heartbeat of a ground station, so its failsafe `data_link_loss` will act. "
                "As the operator, run `arena up` in a terminal, connect a ground station, or run `arena ps` at least once a minute"
            )

    def _send_heartbeat(self, out: list[Out], now: float) -> None:
        self._send(out)

    def _is_over(self, orphaned: bool, now: float) -> bool:
        if not orphaned:
            return False
        over = [
            policy.over(orphaned=True, any_armed=bool(self._router.armed(simulated=simulated)), now=now)
            for simulated, policy in self._shutdown
        ]
        return all(over)

    def _stats(self) -> dict[str, Any]:
        stats = self._router.stats()
        if self._backlog.dropped:
            stats["dropped"]["waited too long"] = self._backlog.dropped
        return stats


def _world_time(path: str | None) -> SimTime | None:
    """Return a reader of the simulation time, or None if the arena has no simulation clock.

    path: path of the simulation clock; None without a simulated world.
    """
    if path is not None:
        with contextlib.suppress(RunError):
            return SimTime(path)
    return None
