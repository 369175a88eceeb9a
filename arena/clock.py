"""Wall clock and simulation clock with the same interface. Code that flies vehicles uses a `Clock`, not the time module.

The process `world` (or `replay`) serves the simulation clock. A page of shared memory holds the time [s], whether the clock is in
lockstep (1) or follows the wall clock (0), and the number of the core on which its only client should sleep (or NO_CORE). A local
socket wakes the clients.
    client -> server   first packet: the client's name, utf-8;  later: a requested wake-up time, one native double [s]
    server -> client   the present time, one native double [s], when the requested time has come
In lockstep the server does not advance beyond the wake-up time of a client until that client sleeps again (`may_advance`).
If a client does not sleep for one second of wall time, the server stops waiting for it until it sleeps again.
"""

from __future__ import annotations

import mmap
import socket
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from arena.errors import RunError
from arena.shared_core import leave, stay_on

Needed = Callable[[float], bool]
DOUBLE = struct.Struct("=d")
_CREDENTIALS = struct.Struct("=3i")  # pid, uid, gid
PAGE_BYTES = 64
MAX_PACKET_BYTES = 256
_ENDED = "the world that serves the simulation clock has ended"


def _no_clock(path: str | Path, error: OSError) -> str:
    return (
        f"cannot open the simulation clock {path}: {error.strerror}. The clock exists only during a run. Start the run "
        "with `arena up`, or correct the path of the clock (`--clock` of a program)"
    )


class Clock(Protocol):
    """Interface of all clocks. The time `now` [s] never decreases, and its zero is arbitrary."""

    def now(self) -> float: ...

    def sleep_until(self, t: float) -> float: ...

    def rate(self, hz: float) -> Rate: ...


class Rate:
    """Timer for a loop with a fixed rate [Hz]. Missed deadlines are skipped."""

    def __init__(self, clock: Clock, hz: float) -> None:
        self._clock, self._period_s = clock, 1.0 / hz
        self._next = clock.now() + self._period_s

    def sleep(self) -> float:
        """Sleep until the next deadline. Return the time after the sleep [s]."""
        now = self._clock.sleep_until(self._next)
        self._next = max(self._next + self._period_s, now)
        return now


class WallClock:
    """Monotonic clock of the computer."""

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, t: float) -> float:
        while (left := t - time.monotonic()) > 0:
            time.sleep(left)
        return time.monotonic()

    def rate(self, hz: float) -> Rate:
        return Rate(self, hz)


class SimTime:
    """Read-only access to the simulation time, for programs that do not sleep in simulation time.

    path: path of the clock's files without the suffix: the shared memory is `<path>.page`
    page: this shared memory; its first number is the simulation time [s]
    Raises RunError if there is no world. After the world has ended the time does not change.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            with Path(f"{path}.page").open("rb") as file:
                self.page = memoryview(mmap.mmap(file.fileno(), PAGE_BYTES, prot=mmap.PROT_READ)).cast("d")
        except OSError as error:
            raise RunError(_no_clock(path, error)) from error

    def now(self) -> float:
        return self.page[0]

    @property
    def lockstep(self) -> bool:
        """True if simulation time advances only while all clients of the clock sleep."""
        return self.page[1] == 1.0


class LockstepClock(ABC):
    """Base class of clocks that count simulation time. While a program sleeps, they call its chores (a function) at regular times."""

    _chores: Callable[[], None] | None = None
    _chores_every_s, _chores_due = 0.0, 0.0

    @property
    @abstractmethod
    def lockstep(self) -> bool:
        """True if simulation time advances only while all clients of the clock sleep."""

    @abstractmethod
    def now(self) -> float:
        """Return the simulation time [s]."""

    @abstractmethod
    def sleep_only(self, t: float) -> float:
        """Sleep until simulation time t [s] and return the time [s]. Never calls the function of `do_while_asleep`."""

    def do_while_asleep(self, chores: Callable[[], None], every_s: float, needed: Needed) -> None:
        """Set a function that `sleep_until` calls during the sleep, every `every_s` seconds of simulation time.

        needed: returns whether the call at a time [s] is needed; if it is not, the sleep is not interrupted.
        """
        self._chores, self._chores_every_s, self._needed = chores, every_s, needed
        self._chores_due = self.now() + every_s

    def sleep_until(self, t: float) -> float:
        """Sleep until the simulation time t [s]. Return the time after the sleep [s]."""
        while self._chores is not None and self._chores_due < t:
            if self._needed(self._chores_due):
                now = self.sleep_only(self._chores_due)
                self._chores_due = now + self._chores_every_s
                self._chores()
            else:
                self._chores_due += self._chores_every_s
        return self.sleep_only(t)

    def rate(self, hz: float) -> Rate:
        """Return a timer for a loop with a fixed rate [Hz]."""
        return Rate(self, hz)


class SimClock(LockstepClock):
    """Client of the simulation clock, for programs that sleep in simulation time.

    path: path of the clock's files without the suffix: `<path>.page` (shared memory) and `<path>.sock` (socket)
    name: name of this client, by which the world waits for it
    Raises RunError if there is no world, or if the world ends during a sleep.
    """

    def __init__(self, path: str | Path, name: str) -> None:
        time = SimTime(path)
        self._page, self._lockstep = time.page, time.lockstep
        try:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self._socket.connect(f"{path}.sock")
            self._socket.send(name.encode())
        except OSError as error:
            raise RunError(_no_clock(path, error)) from error

    @property
    def lockstep(self) -> bool:
        return self._lockstep

    def now(self) -> float:
        return self._page[0]

    def sleep_only(self, t: float) -> float:
        core = int(self._page[2])  # read first: the reply to the request may already publish another one
        self.request_wake(t)
        cores = stay_on(core)
        try:
            while (now := self.wait_for_wake(None)) is None:
                pass
        finally:
            leave(cores)
        return now

    def request_wake(self, t: float) -> None:
        """Request a wake-up at simulation time t [s] from the clock server. Then call `wait_for_wake`."""
        try:
            self._socket.send(DOUBLE.pack(t))
        except OSError as error:
            raise RunError(_ENDED) from error

    def wait_for_wake(self, timeout_s: float | None) -> float | None:
        """Wait until the requested wake-up time. Return the time [s]; None after the timeout.

        timeout_s: wall time [s]. 0 does not wait, None waits without a limit.
        """
        if timeout_s != self._socket.gettimeout():
            self._socket.settimeout(timeout_s)
        try:
            packet = self._socket.recv(DOUBLE.size)
        except (TimeoutError, BlockingIOError):
            return None
        except OSError as error:
            raise RunError(_ENDED) from error
        if len(packet) != DOUBLE.size:
            raise RunError(_ENDED)
        return float(DOUBLE.unpack(packet)[0])

    def fileno(self) -> int:
        """Return a file descriptor that is readable at the wake-up time, or when the clock server has ended."""
        return self._socket.fileno()

    @property
    def server_pid(self) -> int:
        """Process id of the clock server, which is the process `world` or, in a replay, `replay`."""
        raw = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        return int(_CREDENTIALS.unpack(raw)[0])

    def ended(self) -> bool:
        """Return whether the process that contains the clock server has ended. Never blocks.

        Do not call this function between `request_wake` and `wait_for_wake`, because it would consume the wake-up.
        """
        try:
            return self._socket.recv(DOUBLE.size, socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    def close(self) -> None:
        """Close the connection to the clock."""
        self._socket.close()
