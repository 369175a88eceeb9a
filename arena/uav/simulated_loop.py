"""`run`, which runs an asynchronous program on the wall clock or in simulated time.

On the wall clock it works as `asyncio.run`. In simulated time, the time of the event loop is the simulation clock.

On the simulation clock, `asyncio.sleep`, time-outs and `AsyncUAV` all use simulated time. In lockstep the world waits while the
program computes, and advances while all tasks wait.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, TypeVar

from arena.clock import Clock, LockstepClock, Needed, SimClock
from arena.errors import InputError, RunError
from arena.uav.arguments import simulation_clock

T = TypeVar("T")
_FOREVER_S = 1e9


def run(main: Coroutine[Any, Any, T], argv: Sequence[str] | None = None) -> T:
    """Run an asynchronous program and return its result.

    main: coroutine of the program, such as `main()`.
    argv: arguments without the program's name; None for those of this process. They select the clock, as in `UAV.from_args`.
    """
    client = simulation_clock(argv)
    with asyncio.Runner(
        loop_factory=None if client is None else lambda: SimulatedLoop(SimClock(*client))
    ) as r:
        return r.run(main)


def running_clock(path: str | None, name: str) -> Clock | None:
    """Return the clock for a vehicle that a program flies in the running event loop; None means the wall clock.

    path: path of the simulation clock that the program must use. name: name of the vehicle.
    Raises InputError if the event loop does not use the simulation clock.
    """
    loop = asyncio.get_running_loop()
    if path is None:
        return None
    if not isinstance(loop, SimulatedLoop):
        raise InputError(
            f"{name}: this run has a simulation clock: start the program with arena.uav.run(main())"
        )
    return LoopClock(loop)


class SimulatedLoop(asyncio.SelectorEventLoop):
    """Event loop whose time is the simulation clock.

    sim_clock: client of the simulation clock, which sleeps for all tasks of the program.
    """

    def __init__(self, sim_clock: SimClock) -> None:
        self.sim_clock = sim_clock
        super().__init__(_SimulatedSelector(sim_clock))

    def time(self) -> float:
        """Return the simulation time [s]."""
        return self.sim_clock.now()

    def close(self) -> None:
        """Close the event loop and the connection to the simulation clock."""
        super().close()
        self.sim_clock.close()


class LoopClock(LockstepClock):
    """Clock of a vehicle that an asynchronous program flies in simulated time.

    Only the event loop sleeps on it.
    """

    def __init__(self, loop: SimulatedLoop) -> None:
        self._loop = loop

    @property
    def lockstep(self) -> bool:
        return self._loop.sim_clock.lockstep

    def now(self) -> float:
        return self._loop.time()

    def sleep_only(self, t: float) -> float:
        """Raise RunError in place of a blocking sleep, because an asynchronous program must not block."""
        raise RunError(
            "a blocking sleep in an asynchronous program: use `await asyncio.sleep(...)` and the methods of AsyncUAV"
        )

    def do_while_asleep(self, chores: Callable[[], None], every_s: float, needed: Needed) -> None:
        """Make the event loop call the function `chores` every `every_s` seconds of simulation time, if it is needed."""

        def again() -> None:
            if needed(self.now()):
                chores()
            self._loop.call_later(every_s, again)

        self._loop.call_later(every_s, again)


class _SimulatedSelector(selectors.EpollSelector):
    """Selector of the event loop, whose time-outs are in simulation time.

    It returns early when another file descriptor is ready.
    """

    def __init__(self, sim_clock: SimClock) -> None:
        super().__init__()
        self._clock = sim_clock
        self.register(sim_clock, selectors.EVENT_READ)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait at most `timeout` [s] of simulation time. None means no limit."""
        if timeout is not None and timeout <= 0.0:
            return self._others(super().select(0))
        self._clock.request_wake(self._clock.now() + (_FOREVER_S if timeout is None else timeout))
        ready = super().select(None)
        others = self._others(ready)
        if len(others) < len(ready):
            self._clock.wait_for_wake(0)
        return others

    def _others(
        self, ready: list[tuple[selectors.SelectorKey, int]]
    ) -> list[tuple[selectors.SelectorKey, int]]:
        """Return the ready file descriptors, except that of the simulation clock."""
        return [(key, events) for key, events in ready if key.fileobj is not self._clock]
