"""Wall clock and simulation clock behind one face. Code that flies asks a Clock, never the time module.

The simulation clock is served by the world: a page of shared memory tells the time, a local socket wakes sleepers.
    client -> server   first packet: the client's name, utf-8;  later: the time to be woken at, one native double [s]
    server -> client   the time now, one native double [s], when that time has come
A lockstep server does not move past the earliest wake-up until that client sleeps again (`may_pass`), and strikes off
one that has not slept for a second of wall time, until it sleeps again.
"""

from __future__ import annotations

import contextlib
import mmap
import selectors
import socket
import struct
import time
from pathlib import Path
from typing import Protocol

from arena.errors import RunError

_DOUBLE = struct.Struct("=d")
_CREDENTIALS = struct.Struct("=3i")  # pid, uid, gid
_PAGE_BYTES = 64
_HUNG_AFTER_S = 1.0
_ENDED = "the world that serves the simulation clock has ended"


class Clock(Protocol):
    """now: seconds, monotonic. Only differences mean anything."""

    def now(self) -> float: ...

    def sleep_until(self, t: float) -> float: ...

    def rate(self, hz: float) -> Rate: ...


class Rate:
    """Sleeps to absolute deadlines 1/hz apart; deadlines missed are skipped, not caught up in a burst."""

    def __init__(self, clock: Clock, hz: float) -> None:
        self._clock, self._period_s = clock, 1.0 / hz
        self._next = clock.now() + self._period_s

    def sleep(self) -> float:
        """Sleep to the next deadline; returns the time now [s]."""
        now = self._clock.sleep_until(self._next)
        self._next = max(self._next + self._period_s, now)
        return now


class WallClock:
    """The computer's monotonic clock."""

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, t: float) -> float:
        while (left := t - time.monotonic()) > 0:
            time.sleep(left)
        return time.monotonic()

    def rate(self, hz: float) -> Rate:
        return Rate(self, hz)


class SimTime:
    """What time it is in the world, and no more: the page alone, without being a client. path: the stem of `<path>.page`.

    Raises RunError when the world is not there. When it ends, time stands still.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            with Path(f"{path}.page").open("rb") as file:
                self._page = memoryview(mmap.mmap(file.fileno(), _PAGE_BYTES, prot=mmap.PROT_READ)).cast("d")
        except OSError as error:
            raise RunError(f"no simulation clock at {path} ({error.strerror}): is the arena up?") from error

    def now(self) -> float:
        return self._page[0]


class SimClock:
    """A client of the world's clock. path: the stem of `<path>.page` and `<path>.sock`.

    Raises RunError when the world is not there, or ends while one sleeps.
    """

    def __init__(self, path: str | Path, name: str) -> None:
        self.now = SimTime(path).now
        try:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self._socket.connect(f"{path}.sock")
            self._socket.send(name.encode())
        except OSError as error:
            raise RunError(f"no simulation clock at {path} ({error.strerror}): is the arena up?") from error

    def sleep_until(self, t: float) -> float:
        self.ask(t)
        while (now := self.told(None)) is None:
            pass
        return now

    def ask(self, t: float) -> None:
        """The first half of `sleep_until`: time may go on, and `told` says when it is t [s]."""
        try:
            self._socket.send(_DOUBLE.pack(t))
        except OSError as error:
            raise RunError(_ENDED) from error

    def told(self, patience_s: float | None) -> float | None:
        """The second half: the time [s] when what was asked for has come; None when it has not
        within patience_s [s] of wall time; 0: without waiting."""
        if patience_s != self._socket.gettimeout():
            self._socket.settimeout(patience_s)
        try:
            told = self._socket.recv(_DOUBLE.size)
        except (TimeoutError, BlockingIOError):
            return None
        except OSError as error:
            raise RunError(_ENDED) from error
        if len(told) != _DOUBLE.size:
            raise RunError(_ENDED)
        return float(_DOUBLE.unpack(told)[0])

    def rate(self, hz: float) -> Rate:
        return Rate(self, hz)

    def fileno(self) -> int:
        """Readable when `told` has something to tell, or the world has ended: for those who wait for other things as well."""
        return self._socket.fileno()

    @property
    def server_pid(self) -> int:
        """The process that serves this clock."""
        pid, _, _ = _CREDENTIALS.unpack(
            self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        )
        return int(pid)

    def ended(self) -> bool:
        """Has the world gone? Never blocks; not to be asked while asleep."""
        try:
            return self._socket.recv(_DOUBLE.size, socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    def close(self) -> None:
        self._socket.close()


class _Sleeper:
    """One client as the server sees it. wake: the time it asked for [s], None while it is awake."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.name = ""
        self.wake: float | None = None
        self.gates = False
        self.awake_since = 0.0


class ClockServer:
    """The world's side. `tick(now)` publishes a time; in lockstep ask `may_pass` before the next one is published."""

    def __init__(self, path: str | Path) -> None:
        self._stem = Path(path)
        page, sock = Path(f"{path}.page"), Path(f"{path}.sock")
        for stale in (page, sock):
            stale.unlink(missing_ok=True)
        part = Path(f"{path}.page.new")  # a client finds the page whole or not at all
        with part.open("w+b") as file:
            file.truncate(_PAGE_BYTES)
            self._page = memoryview(mmap.mmap(file.fileno(), _PAGE_BYTES)).cast("d")
        part.replace(page)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.bind(str(sock))
        sock.chmod(0o600)
        self._socket.listen(512)
        self._socket.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._socket, selectors.EVENT_READ)
        self._sleepers: dict[int, _Sleeper] = {}
        self.struck_off: list[str] = []

    def tick(self, now: float) -> None:
        """Publish the time [s], hear the clients and wake whoever is due."""
        self._page[0] = now
        self.poll()
        for sleeper in list(self._sleepers.values()):
            if sleeper.wake is not None and sleeper.wake <= now + 1e-9:
                self._tell(sleeper, now)

    def poll(self, timeout_s: float = 0.0) -> None:
        """Accept and read whatever has arrived."""
        for key, _ in self._selector.select(timeout_s):
            if key.fileobj is self._socket:
                self._accept()
            else:
                self._hear(self._sleepers[key.fd])

    def may_pass(self, now: float, wall: float) -> bool:
        """Lockstep: is every gating client asleep? One awake for over a second of wall time is struck off by name."""
        passing = True
        for sleeper in self._sleepers.values():
            if sleeper.gates and sleeper.wake is None:
                if wall - sleeper.awake_since > _HUNG_AFTER_S:
                    sleeper.gates = False
                    self.struck_off.append(sleeper.name)
                else:
                    passing = False
        return passing

    def close(self) -> None:
        for sleeper in list(self._sleepers.values()):
            self._drop(sleeper)
        self._socket.close()
        for ending in ("page", "sock"):
            Path(f"{self._stem}.{ending}").unlink(missing_ok=True)

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            connection, _ = self._socket.accept()
            connection.setblocking(False)
            self._sleepers[connection.fileno()] = _Sleeper(connection)
            self._selector.register(connection, selectors.EVENT_READ)

    def _hear(self, sleeper: _Sleeper) -> None:
        try:
            packet = sleeper.connection.recv(256)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        if not packet:
            self._drop(sleeper)
        elif not sleeper.name:
            sleeper.name = packet.decode(errors="replace")
        elif len(packet) == _DOUBLE.size:
            sleeper.wake, sleeper.gates = _DOUBLE.unpack(packet)[0], True
            if sleeper.wake <= self._page[0]:
                self._tell(sleeper, self._page[0])

    def _tell(self, sleeper: _Sleeper, now: float) -> None:
        sleeper.wake, sleeper.awake_since = None, time.monotonic()
        try:
            sleeper.connection.send(_DOUBLE.pack(now))
        except OSError:
            self._drop(sleeper)

    def _drop(self, sleeper: _Sleeper) -> None:
        self._selector.unregister(sleeper.connection)
        self._sleepers.pop(sleeper.connection.fileno(), None)
        sleeper.connection.close()
