"""Router process with fault injection: a socket receives the faults, such as loss and delay.

A fault makes a link lose or delay datagrams. Delays are measured in simulation time, or in wall time if there is no
simulation clock.

While no fault is active, datagrams are routed as in `RouterShell`. While a datagram is delayed, the router is
a client of the simulation clock, so that simulation time waits for the router.
"""

from __future__ import annotations

import contextlib
import math
import select
import time

from arena.clock import SimClock
from arena.errors import RunError
from arena.fault_injection import FaultReceiver
from arena.mavlink_router.endpoints import Out
from arena.mavlink_router.link_impairment import ImpairedRouter
from arena.mavlink_router.routing_table import Table
from arena.mavlink_router.shell import RouterShell
from arena.process_context import ProcessContext
from arena.transport import Address
from arena.wire.mavlink_frame import Buffer


class FaultInjectionShell(RouterShell):
    """Router process whose links can lose and delay datagrams, for fault injection.

    faults: path of the socket that receives faults
    impaired: the router with impaired links
    """

    def __init__(self, process: ProcessContext, table: Table, faults: str) -> None:
        super().__init__(process, table)
        self.impaired = ImpairedRouter(self._router, int(process.settings.get("seed", 0)))
        self._faults = FaultReceiver(faults)
        self._poll.register(self._faults.fileno(), select.EPOLLIN)
        self._clock_path: str | None = process.settings.get("clock")
        self._clock: SimClock | None = None
        self._wake_at: float | None = None  # requested from the simulation clock [s]; None: none requested

    def close(self) -> None:
        super().close()
        self._faults.close()
        self._leave_clock()

    def _on_other_event(self, fd: int) -> None:
        self._update(time.monotonic())

    def _tick(self, now: float) -> None:
        super()._tick(now)
        self._update(now)

    def _send_heartbeat(self, out: list[Out], now: float) -> None:
        if not self.impaired.muted:
            self._send(self.impaired.outgoing(out, self._delay_time(now)))

    def _update(self, now: float) -> None:
        """Apply received faults, and send datagrams whose delay has ended.

        Also set the time of the next wake-up, which is the end of the next delay.

        now: monotonic [s].
        """
        for text in self._faults.apply(self.impaired.apply):
            self._process.event(text)
        try:
            self._join_clock()
            at = self._delay_time(now)
        except RunError as error:
            self._process.event(
                f"fault injection: no simulation clock for delays ({error}). Loss and delay of all links are set to 0"
            )
            self.impaired.clear()
            self._leave_clock()
            self._clock_path, at = None, math.inf
        self._send(self.impaired.release(now, at))
        self._in_loop = not self.impaired.active
        self._route = self._route_impaired if self.impaired.active else self._router.on_datagram
        if not self.impaired.delaying:
            self._leave_clock()
        self._request_wake()

    def _route_impaired(self, socket: int, sender: Address, data: Buffer, now: float) -> list[Out]:
        out = self.impaired.on_datagram(socket, sender, data, now, self._delay_time(now))
        self._request_wake()
        return out

    def _delay_time(self, now: float) -> float:
        return now if self._clock is None else self._clock.now()

    def _join_clock(self) -> None:
        """Connect to the simulation clock as soon as a link delays datagrams.

        Delays are measured in simulation time.

        Raises RunError if the process that serves the clock has ended.
        """
        if self._clock is None and self.impaired.delaying and self._clock_path is not None:
            self._clock = SimClock(self._clock_path, self._process.name)
            self._poll.register(self._clock.fileno(), select.EPOLLIN)
        elif self._clock is not None and self._clock.wait_for_wake(0.0) is not None:
            self._wake_at = None

    def _request_wake(self) -> None:
        due = math.inf if self.impaired.due is None else self.impaired.due
        if self._clock is None:
            self._next_tick = min(self._next_tick, due)
        elif due != self._wake_at:
            self._wake_at = due
            with contextlib.suppress(RunError):  # a clock that has ended is readable, and found ended there
                self._clock.request_wake(due)

    def _leave_clock(self) -> None:
        if self._clock is not None:
            self._clock.close()
        self._clock, self._wake_at = None, None
