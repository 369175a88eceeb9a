"""Wall clock and simulation clock with the same interface. Code that flies vehicles uses a `Clock`, not the time module.

The process `world` (or `replay`) serves the simulation clock. A page of shared memory holds the time [s] and whether the clock is in
lockstep (1) or follows the wall clock (0). A local socket wakes the clients.
    client -> server   first packet: the client's name, utf-8;  later: a requested wake-up time, one native double [s]
    server -> client   the present time, one native double [s], when the requested time has come
In lockstep the server does not advance beyond the wake-up time of a client until that client sleeps again (`may_advance`).
If a client does not sleep for one second of wall time, the server stops waiting for it until it sleeps again.
"""

from __future__ import annotations

import contextlib
import math
import mmap
import select
import socket
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from arena.errors import RunError

Needed = Callable[[float], bool]
_DOUBLE = struct.Struct("=d")
_TIMEVAL = struct.Struct("@ll")  # seconds, microseconds
_CREDENTIALS = struct.Struct("=3i")  # pid, uid, gid
_PAGE_BYTES = 64
_MAX_PACKET_BYTES = 256
_HUNG_S = 1.0
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
                self.page = memoryview(mmap.mmap(file.fileno(), _PAGE_BYTES, prot=mmap.PROT_READ)).cast("d")
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
        self.request_wake(t)
        while (now := self.wait_for_wake(None)) is None:
            pass
        return now

    def request_wake(self, t: float) -> None:
        """Request a wake-up at simulation time t [s] from the clock server. Then call `wait_for_wake`."""
        try:
            self._socket.send(_DOUBLE.pack(t))
        except OSError as error:
            raise RunError(_ENDED) from error

    def wait_for_wake(self, timeout_s: float | None) -> float | None:
        """Wait until the requested wake-up time. Return the time [s]; None after the timeout.

        timeout_s: wall time [s]. 0 does not wait, None waits without a limit.
        """
        if timeout_s != self._socket.gettimeout():
            self._socket.settimeout(timeout_s)
        try:
            packet = self._socket.recv(_DOUBLE.size)
        except (TimeoutError, BlockingIOError):
            return None
        except OSError as error:
            raise RunError(_ENDED) from error
        if len(packet) != _DOUBLE.size:
            raise RunError(_ENDED)
        return float(_DOUBLE.unpack(packet)[0])

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
            return self._socket.recv(_DOUBLE.size, socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    def close(self) -> None:
        """Close the connection to the clock."""
        self._socket.close()


class _Client:
    """Connection of the clock server to one client, a process that sleeps in simulation time.

    wake: requested wake-up time [s]; None while the client is awake
    gates: in lockstep, the world waits while this client is awake
    """

    def __init__(self, connection: socket.socket) -> None:
        self.connection, self.name, self.gates = connection, "", False
        self.wake: float | None = None
        self.awake_since = self._limit_s = 0.0
        connection.setblocking(True)

    def limit_wait(self, timeout_s: float) -> None:
        """Limit the time for which the next `recv` waits for a request of this client [s].

        A timeout set with `settimeout` would cost one more system call for each wait.
        """
        if timeout_s != self._limit_s:
            self._limit_s = timeout_s
            timeval = _TIMEVAL.pack(int(timeout_s), int(1e6 * (timeout_s % 1.0)))
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeval)


class ClockServer:
    """Server of the simulation clock, in the simulation or a replay. In lockstep, call `may_advance` before each `tick`.

    lockstep: the world waits for the clients (see `SimTime.lockstep`).
    dropped: names of the clients for which the world no longer waits.
    joined: names of the clients that have requested a wake-up at least once.
    asleep: names of the clients that wait for their wake-up now.
    before_wake: called with the name of a client directly before the client is woken.
    """

    def __init__(self, path: str | Path, *, lockstep: bool = False) -> None:
        self._stem = Path(path)
        page, sock, part, unready = (Path(f"{path}.{end}") for end in ("page", "sock", "page.new", "new"))
        for stale in (page, sock, unready):
            stale.unlink(missing_ok=True)
        with part.open("w+b") as file:  # renamed when complete: a client finds the whole page or none
            file.truncate(_PAGE_BYTES)
            self._page = memoryview(mmap.mmap(file.fileno(), _PAGE_BYTES)).cast("d")
        self._page[1] = float(lockstep)
        self._next_wake = math.inf  # no client sleeps until an earlier time [s]
        part.replace(page)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.bind(str(unready))
        unready.chmod(0o600)
        self._socket.listen(512)
        unready.rename(sock)  # a client never finds a socket that refuses the connection
        self._socket.setblocking(False)
        self._epoll = select.epoll()
        self._epoll.register(self._socket, select.EPOLLIN)
        self._clients: dict[int, _Client] = {}
        self.dropped: list[str] = []
        self.joined: set[str] = set()
        self.asleep: set[str] = set()
        self.before_wake: Callable[[str], None] = lambda name: None

    def tick(self, now: float, *, poll: bool = True) -> None:
        """Publish the simulation time [s], and wake each client whose wake-up time has come.

        poll: read the wake-up requests of the clients first. False saves a system call if `poll` is called before each step.
        """
        self._page[0] = now
        if poll:
            self.poll()
        if now + 1e-9 < self._next_wake:
            return
        self._next_wake = math.inf
        for client in list(self._clients.values()):
            if client.wake is not None and client.wake <= now + 1e-9:
                self._wake(client, now)
            elif client.wake is not None:
                self._next_wake = min(self._next_wake, client.wake)

    def fileno(self) -> int:
        """Return a file descriptor that is readable when a client has sent data or has connected."""
        return self._epoll.fileno()

    def poll(self, timeout_s: float = 0.0) -> None:
        """Accept new clients, and read the requests of all clients."""
        for fd, _ in self._epoll.poll(timeout_s):
            client = self._clients.get(fd)
            if client is None:
                self._accept()
            else:
                self._read(client, socket.MSG_DONTWAIT)

    def wait_for_requests(self, timeout_s: float) -> bool:
        """Wait until every client sleeps, which means that it has requested its next wake-up. Return False after a timeout.

        Clients for which the world does not wait are ignored (`_Client.gates`).

        Blocking in `recv` takes one system call per request. Other clients are served by `poll`, which this method calls if a
        client sent nothing.
        timeout_s: longest wait for one client, in wall time [s].
        """
        for client in [c for c in self._clients.values() if c.gates and c.wake is None]:
            client.limit_wait(timeout_s)
            if not self._read(client):
                self.poll()
                return False
        return True

    def may_advance(self, now: float, wall: float) -> bool:
        """Return whether simulation time may advance in lockstep: no client may be awake.

        A client that has been awake for more than one second of wall time is added to `dropped` and not waited for any more.
        """
        awake = [client for client in self._clients.values() if client.gates and client.wake is None]
        for client in awake:
            if wall - client.awake_since > _HUNG_S:
                client.gates = False
                self.dropped.append(client.name)
        return not any(client.gates for client in awake)

    def has_disconnected(self, name: str) -> bool:
        """Return whether a client with this name has used the clock and has then disconnected."""
        return name in self.joined and all(client.name != name for client in self._clients.values())

    def close(self) -> None:
        """Disconnect all clients, and remove the clock's shared memory and socket."""
        for client in list(self._clients.values()):
            self._drop(client)
        self._socket.close()
        self._epoll.close()
        for ending in ("page", "sock"):
            Path(f"{self._stem}.{ending}").unlink(missing_ok=True)

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            connection, _ = self._socket.accept()
            self._clients[connection.fileno()] = _Client(connection)
            self._epoll.register(connection, select.EPOLLIN)

    def _read(self, client: _Client, flags: int = 0) -> bool:
        """Read one packet of a client: its name, or a wake-up time. Return False if no packet has arrived.

        flags: flags for `recv`, such as MSG_DONTWAIT to return at once
        """
        try:
            packet = client.connection.recv(_MAX_PACKET_BYTES, flags)
        except BlockingIOError:
            return False
        except OSError:
            packet = b""
        if not packet:
            self._drop(client)
        elif not client.name:
            client.name = packet.decode(errors="replace")
        elif len(packet) == _DOUBLE.size:
            if not client.gates:
                self.joined.add(client.name)
            client.wake, client.gates = _DOUBLE.unpack(packet)[0], True
            if client.wake <= self._page[0]:
                self._wake(client, self._page[0])
            else:
                self.asleep.add(client.name)
                self._next_wake = min(self._next_wake, client.wake)
        return True

    def _wake(self, client: _Client, now: float) -> None:
        client.wake, client.awake_since = None, time.monotonic()
        self.asleep.discard(client.name)
        self.before_wake(client.name)
        try:
            client.connection.send(_DOUBLE.pack(now), socket.MSG_DONTWAIT)
        except OSError:
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        self.asleep.discard(client.name)
        self._epoll.unregister(client.connection)
        self._clients.pop(client.connection.fileno(), None)
        client.connection.close()
