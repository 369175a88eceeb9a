"""The door of one vehicle's simulator port: who connects counts as PX4 once it has spoken MAVLink, which PX4 does at once.

Anybody may knock on a TCP port: a scanner, a browser, a second PX4 with the same id. None of them may take the vehicle's place.
"""

from __future__ import annotations

import contextlib
import socket
from collections import Counter

from arena.errors import RunError
from arena.wire.mavlink_frame import Stream

PROVE_S = 2.0
"""Wall time in which a caller must have said something valid [s]."""
_MOST_CALLERS = 4
_BYTES = 4096


class _Caller:
    """A connection that has not proven anything yet. since: wall time [s]; said: all it has sent."""

    def __init__(self, connection: socket.socket, peer: str, since: float) -> None:
        self.connection, self.peer, self.since = connection, peer, since
        self.said = b""
        self._stream = Stream()

    def listen(self, now: float) -> str | None:
        """None while it may still prove itself; "" once it has; else why it is sent away."""
        try:
            data = self.connection.recv(_BYTES)
        except BlockingIOError:
            return None if now - self.since < PROVE_S else f"said nothing valid within {PROVE_S:g} s"
        except OSError:
            data = b""
        if not data:
            return "hung up without a word"
        self.said += data
        _, found = self._stream.feed(data)
        if len(found.frames) > found.unknown:
            return ""
        if found.garbage or found.unknown:
            return "does not speak MAVLink"
        return None if now - self.since < PROVE_S else f"said nothing valid within {PROVE_S:g} s"


class Door:
    """Listens on the address. counts: strangers sent away, connections refused. Raises RunError when the port is taken."""

    def __init__(self, name: str, address: tuple[str, int]) -> None:
        self._name, self._address = name, address
        self._callers: list[_Caller] = []
        self._told: set[str] = set()
        self.counts: Counter[str] = Counter()
        self.events: list[str] = []
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind(address)
        except OSError as error:
            self._listener.close()
            raise RunError(
                f"{name}: cannot serve the simulator API on {address[0]}:{address[1]}: {error.strerror}"
            ) from error
        self._listener.listen(_MOST_CALLERS)
        self._listener.setblocking(False)

    def look(self, now: float, *, taken: bool) -> tuple[socket.socket, bytes] | None:
        """Who has proven to be PX4, and what it has said already. now: wall time [s]. taken: a PX4 is there, nobody gets in."""
        while (caller := self._accept(now)) is not None:
            if caller.peer.rpartition(":")[0] not in (
                self._address[0],
                "127.0.0.1",
            ):  # where our own PX4s connect from
                self._callers.append(caller)
                self._send_away(caller, "comes from another address than this computer's")
            elif taken or len(self._callers) >= _MOST_CALLERS:
                self._refuse(caller)
            else:
                self._callers.append(caller)
        for caller in list(self._callers):
            verdict = caller.listen(now)
            if verdict == "":
                self._callers.remove(caller)
                self._empty()
                return caller.connection, caller.said
            if verdict:
                self._send_away(caller, verdict)
        return None

    def close(self) -> None:
        self._listener.close()
        for caller in self._callers:
            caller.connection.close()

    def _accept(self, now: float) -> _Caller | None:
        try:
            connection, (host, port) = self._listener.accept()
        except OSError:
            return None
        connection.setblocking(False)
        with contextlib.suppress(OSError):  # it has gone already
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return _Caller(connection, f"{host}:{port}", now)

    def _empty(self) -> None:
        """PX4 is here: whoever else waits has come for nothing."""
        for caller in self._callers:
            self._refuse(caller)
        self._callers = []
        self._told.discard("refused")

    def _refuse(self, caller: _Caller) -> None:
        caller.connection.close()
        self.counts["refused"] += 1
        self._tell(
            "refused",
            f"a further connection from {caller.peer} was refused: one PX4 is connected or expected there",
        )

    def _send_away(self, caller: _Caller, why: str) -> None:
        self._callers.remove(caller)
        caller.connection.close()
        self.counts["strangers"] += 1
        self._tell(why, f"a connection from {caller.peer} was closed: it {why}, so it is no PX4")

    def _tell(self, kind: str, text: str) -> None:
        """Each kind of thing once: a scanner that comes every second is no news."""
        if kind not in self._told:
            self._told.add(kind)
            host, port = self._address
            self.events.append(f"{self._name}: simulator port {host}:{port}: {text}")
