"""Server of the simulation clock, in the process `world` or `replay`. `arena.clock` has the clients and describes the packets."""

from __future__ import annotations

import contextlib
import math
import mmap
import select
import socket
import struct
import time
from collections.abc import Callable
from pathlib import Path

from arena.clock import DOUBLE, MAX_PACKET_BYTES, PAGE_BYTES
from arena.shared_core import NO_CORE, leave, present_core, stay_on

_TIMEVAL = struct.Struct("@ll")  # seconds, microseconds
_HUNG_S, _LONGEST_CHECK_S = 1.0, 0.1


class _Client:
    """Connection of the clock server to one client, a process that sleeps in simulation time.

    wake: requested wake-up time [s]; None while the client is awake
    awake_s: wall time for which the world has waited for the client since its wake-up [s]
    past_requests: number of requests for a time in the past since the last sleep
    gates: in lockstep, the world waits while this client is awake
    """

    def __init__(self, connection: socket.socket) -> None:
        self.connection, self.name, self.gates = connection, "", False
        self.wake: float | None = None
        self.awake_since = self.awake_s = self._limit_s = 0.0
        self.past_requests = 0
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
    """Server of the simulation clock, used by the simulation and by a replay.

    Call `tick` in each step of the simulation. In lockstep, first call `may_advance` until it returns True.

    lockstep: the world waits for the clients (see `SimTime.lockstep`).
    dropped: names of the clients for which the world no longer waits.
    joined: names of the clients that have requested a wake-up at least once.
    asleep: names of the clients that wait for their wake-up now.
    wakes: number of wake-ups so far, of all clients.
    before_wake: called with the name of a client directly before the client is woken.
    """

    def __init__(self, path: str | Path, *, lockstep: bool = False) -> None:
        self._stem = Path(path)
        page, sock, part, unready = (Path(f"{path}.{end}") for end in ("page", "sock", "page.new", "new"))
        for stale in (page, sock, unready):
            stale.unlink(missing_ok=True)
        with part.open("w+b") as file:  # renamed when complete: a client finds the whole page or none
            file.truncate(PAGE_BYTES)
            self._page = memoryview(mmap.mmap(file.fileno(), PAGE_BYTES)).cast("d")
        self._page[1], self._page[2] = float(lockstep), NO_CORE
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
        self._checked = 0.0  # wall time of the last `may_advance` [s]
        self.dropped: list[str] = []
        self.joined: set[str] = set()
        self.asleep: set[str] = set()
        self.wakes = 0
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
        awake = [c for c in self._clients.values() if c.gates and c.wake is None]
        cores = stay_on(int(self._page[2]))
        try:
            for client in awake:
                client.limit_wait(timeout_s)
                if not self._read(client):
                    self.poll()
                    return False
        finally:
            leave(cores)
        return True

    def may_advance(self, now: float, wall: float) -> bool:
        """Return whether simulation time may advance in lockstep: no client may be awake.

        A client that has been awake for more than one second of wall time is added to `dropped` and not waited for any more. A
        pause between two calls counts as `_LONGEST_CHECK_S` at most, because the whole computer may have stood still.
        """
        awake = [client for client in self._clients.values() if client.gates and client.wake is None]
        for client in awake:
            client.awake_s += min(wall - max(client.awake_since, self._checked), _LONGEST_CHECK_S)
            if client.awake_s > _HUNG_S:
                client.gates = False
                self.dropped.append(client.name)
        self._checked = wall
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
            packet = client.connection.recv(MAX_PACKET_BYTES, flags)
        except BlockingIOError:
            return False
        except OSError:
            packet = b""
        if not packet:
            self._drop(client)
        elif not client.name:
            client.name = packet.decode(errors="replace")
        elif len(packet) == DOUBLE.size:
            self._on_request(client, DOUBLE.unpack(packet)[0])
        return True

    def _on_request(self, client: _Client, wake: float) -> None:
        """Process the request of a client to be woken at a simulation time [s].

        A time in the past is no sleep: the client counts as awake since its last wake-up. Otherwise a client that asks again and
        again would stop simulation time for ever. Only the first such request counts as a sign of life: after it, the world waits
        again for a client that it has dropped, because a loop with a fixed rate asks so after a long computation.
        """
        now = self._page[0]
        self.joined.add(client.name)
        if wake > now:
            client.wake, client.gates, client.past_requests = wake, True, 0
            self.asleep.add(client.name)
            self._next_wake = min(self._next_wake, wake)
            return
        if client.wake is not None:  # it ends an earlier sleep
            self._wake(client, now)
            return
        client.past_requests += 1
        if not client.gates and client.past_requests == 1:
            client.gates, client.awake_since, client.awake_s = True, time.monotonic(), 0.0
        self._reply(client, now)

    def _wake(self, client: _Client, now: float) -> None:
        client.wake, client.awake_since, client.awake_s = None, time.monotonic(), 0.0
        self._reply(client, now)

    def _share_core(self) -> None:
        """Publish the core on which the only client should sleep: that of the world. With several clients: NO_CORE."""
        takes_turns = self._page[1] == 1.0 and len(self._clients) == 1
        self._page[2] = present_core() if takes_turns else NO_CORE

    def _reply(self, client: _Client, now: float) -> None:
        self.wakes += 1
        self._share_core()
        self.asleep.discard(client.name)
        self.before_wake(client.name)
        try:
            client.connection.send(DOUBLE.pack(now), socket.MSG_DONTWAIT)
        except OSError:
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        self.asleep.discard(client.name)
        self._epoll.unregister(client.connection)
        self._clients.pop(client.connection.fileno(), None)
        client.connection.close()
