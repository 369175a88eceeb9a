"""The shell of faults on purpose in the router: their socket, and the clock that delays are measured on.

Nothing of it is in the way of a datagram while nothing is wrong: `on_datagram` is then the router's own. Where there is a world's
clock a delay is of its time: while something waits the router sleeps on it as its other clients do, and time waits for the
router.
"""

from __future__ import annotations

import contextlib
import math
import select
from collections.abc import Callable

from arena.clock import SimClock
from arena.errors import RunError
from arena.fault_injection import Faults
from arena.mavlink_router.link_impairment import ImpairedRouter
from arena.mavlink_router.router import Out, Router
from arena.mavlink_router.routing_table import Address
from arena.process_context import ProcessContext
from arena.wire.mavlink_frame import Buffer


class RouterFaults:
    """poll: where its descriptors are waited on; call `look` when one is readable. wake_at: told when to call it again at the
    latest, monotonic [s].

    on_datagram: instead of the router's, and changing.
    """

    def __init__(
        self, room: ProcessContext, router: Router, poll: select.epoll, wake_at: Callable[[float], None]
    ) -> None:
        self._room, self._router, self._poll, self._wake_at = room, router, poll, wake_at
        self._core = ImpairedRouter(router, int(room.settings.get("seed", 0)))
        self._faults = Faults(room.settings.get("faults"))
        if self._faults.fileno() >= 0:
            poll.register(self._faults.fileno(), select.EPOLLIN)
        self._path: str | None = room.settings.get("clock")
        self._clock: SimClock | None = None
        self._asked: float | None = None  # when to be woken [s] by the world's clock; None: awake
        self.on_datagram = router.on_datagram

    def look(self, now: float) -> list[Out]:
        """Take faults, let go what has waited long enough, ask to be woken for the rest. now: monotonic [s]."""
        for text in self._faults.obey(self._core.spoil):
            self._room.event(text)
        try:
            self._keep_time()
            at = self._at(now)
        except RunError as error:
            self._room.event(f"no more delays on purpose: {error}")
            self._core.calm()
            self._drop_clock()
            self._path, at = None, math.inf
        out = self._core.release(now, at)
        self.on_datagram = self._on_bad_links if self._core.bad else self._router.on_datagram
        if not self._core.delaying:
            self._drop_clock()
        self._ask_to_be_woken()
        return out

    def heartbeat(self, frame: bytes, now: float) -> list[Out]:
        """The router's own, as far as it is to be heard."""
        return [] if self._core.mute else self._core.outgoing(self._router.heartbeat(frame), self._at(now))

    def close(self) -> None:
        self._faults.close()
        self._drop_clock()

    def _on_bad_links(self, socket: int, sender: Address, data: Buffer, now: float) -> list[Out]:
        out = self._core.on_datagram(socket, sender, data, now, self._at(now))
        self._ask_to_be_woken()
        return out

    def _at(self, now: float) -> float:
        return now if self._clock is None else self._clock.now()

    def _keep_time(self) -> None:
        """Be the clock's client once there is something to delay. Raises RunError when it has ended."""
        if self._clock is None and self._core.delaying and self._path is not None:
            self._clock = SimClock(self._path, self._room.name)
            self._poll.register(self._clock.fileno(), select.EPOLLIN)
        elif self._clock is not None and self._clock.told(0.0) is not None:
            self._asked = None

    def _ask_to_be_woken(self) -> None:
        due = math.inf if self._core.due is None else self._core.due
        if self._clock is None:
            self._wake_at(due)
        elif due != self._asked:
            self._asked = due
            with contextlib.suppress(RunError):  # one that has ended is readable
                self._clock.ask(due)

    def _drop_clock(self) -> None:
        if self._clock is not None:
            self._clock.close()
        self._clock, self._asked = None, None
