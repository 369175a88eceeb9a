"""Clocks for the user programs of a group, which run as threads of one process.

The threads share the simulation clock in lockstep, or have separate clocks.

In lockstep exactly one thread runs at a time, and the next thread is the one with the earliest wake-up time, at equal times
the one that fell asleep first. So the order does not depend on the machine, and threads of one group do not race. The world
waits for one client, whatever the number of threads.
"""

from __future__ import annotations

import heapq
import itertools
import threading
from collections.abc import Callable, Sequence

from arena.clock import Clock, LockstepClock, SimClock, SimTime, WallClock
from arena.errors import RunError

Work = Callable[[], None]


class GroupClock:
    """Simulation clock that the threads of a process share. Only one thread runs at a time.

    clock: client of the world's clock; sleeps for all threads.
    """

    def __init__(self, clock: LockstepClock) -> None:
        self.now = clock.now
        self._clock = clock
        self._waiting: list[tuple[float, int, threading.Lock]] = []
        self._order = itertools.count()
        self._failed: RunError | None = None

    def sleep(self, t: float) -> float:
        """Sleep until the time t [s] and return the time afterwards. Other threads run meanwhile."""
        turn = self._ask_for_turn(max(t, self.now()))
        self._pass_turn()
        turn.acquire()
        if self._failed is not None:
            raise RunError(str(self._failed))
        return self.now()

    def run_all(self, work: Sequence[Work]) -> None:
        """Run functions, each in a thread, and return when all have ended. The functions must not raise."""
        left = len(work)
        done = threading.Lock()
        done.acquire()

        def run(one: Work, turn: threading.Lock) -> None:
            nonlocal left
            turn.acquire()
            try:
                one()
            finally:
                left -= 1
                if left == 0:
                    heapq.heappush(self._waiting, (self.now(), next(self._order), done))
                self._pass_turn()

        for one in work:
            turn = self._ask_for_turn(self.now())
            threading.Thread(target=run, args=(one, turn), daemon=True).start()
        if work:
            self._pass_turn()
            done.acquire()

    def _ask_for_turn(self, t: float) -> threading.Lock:
        turn = threading.Lock()
        turn.acquire()
        heapq.heappush(self._waiting, (t, next(self._order), turn))
        return turn

    def _pass_turn(self) -> None:
        """Sleep on the simulation clock until the earliest wake-up time of a thread, then wake this thread."""
        if not self._waiting:
            return
        t, _, turn = heapq.heappop(self._waiting)
        if t > self.now() and self._failed is None:
            try:
                self._clock.sleep_only(t)
            except RunError as error:
                self._failed = error
        turn.release()


class MemberClock(LockstepClock):
    """Simulation clock of one vehicle, in a process that runs the programs of a whole group in lockstep.

    While a program sleeps on this clock, the vehicle's connection receives data and sends heartbeats.
    """

    def __init__(self, group: GroupClock) -> None:
        self._group = group

    @property
    def lockstep(self) -> bool:
        return True

    def now(self) -> float:
        return self._group.now()

    def sleep_only(self, t: float) -> float:
        return self._group.sleep(t)


class GroupThreads:
    """Runner of a group's user programs in threads, which also gives each thread its clock.

    path: path of the simulation clock's files without the suffix, as in `SimClock`; None for the wall clock.
    name: name of the group's process. The process is a client of the simulation clock with this name.
    """

    def __init__(self, path: str | None, name: str) -> None:
        self._path, self._name = path, name
        self._group: GroupClock | None = None
        if path is not None and SimTime(path).lockstep:
            self._group = GroupClock(SimClock(path, name))

    @property
    def client(self) -> tuple[str, str] | None:
        """Path of the simulation clock's files (without suffix), and this process's name as a client of the clock.

        None if the group uses the wall clock.
        """
        return None if self._path is None else (self._path, self._name)

    @property
    def lockstep(self) -> bool:
        """True if only one thread runs at a time, on a common simulation clock."""
        return self._group is not None

    def clock(self, name: str) -> Clock:
        """Return a clock for one thread of the group: the wall clock or a simulation clock.

        name: name of the thread as a client of the simulation clock. In lockstep the name is not used: the whole process is one client.
        """
        if self._group is not None:
            return MemberClock(self._group)
        return WallClock() if self._path is None else SimClock(self._path, name)

    def run_all(self, work: Sequence[Work]) -> None:
        """Run functions, each in a thread, and return when all have ended. The functions must not raise."""
        if self._group is not None:
            return self._group.run_all(work)
        threads = [threading.Thread(target=one, daemon=True) for one in work]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
