"""Who receives frames in unicast. Pure.

Clients differ in where they listen: some at the port that they shake hands from, some at the data port, unannounced. Some send
keepalives, some never do, so silence ends only a client that used to speak.
"""

from __future__ import annotations

from dataclasses import dataclass

from arena.wire import natnet

Address = tuple[str, int]

_SILENT_S = 10.0
_QUIET_S = 0.5  # after CONNECT, no frames to the asking port: the next packet there must be the answer to what it asks next
_MOST = 64


@dataclass(slots=True)
class _Client:
    """heard, quiet_until: wall time [s]. speaks: it has sent a keepalive."""

    heard: float
    quiet_until: float
    speaks: bool = False


class Clients:
    """data_port: where clients listen that do not listen where they ask from."""

    def __init__(self, data_port: int) -> None:
        self._data_port = data_port
        self._known: dict[Address, _Client] = {}

    def heard(self, message: int, sender: Address, now: float) -> None:
        """A packet of a client has been read and is about to be answered. now: wall time [s]."""
        if message == natnet.DISCONNECT:
            self._known.pop(sender, None)
        elif message in (natnet.CONNECT, natnet.KEEPALIVE) and (sender in self._known or self._room()):
            client = self._known.setdefault(sender, _Client(now, now))
            client.heard = now
            client.speaks |= message == natnet.KEEPALIVE
            if message == natnet.CONNECT:
                client.quiet_until = now + _QUIET_S
        elif message == natnet.REQUEST_MODELDEF and sender in self._known:
            self._known[sender].heard = self._known[sender].quiet_until = now

    def destinations(self, now: float) -> list[Address]:
        """Each client's data port, once a host, and the port it asked from."""
        gone = [a for a, c in self._known.items() if c.speaks and now - c.heard >= _SILENT_S]
        for address in gone:
            del self._known[address]
        found = dict.fromkeys((host, self._data_port) for host, _ in self._known)
        found |= dict.fromkeys(a for a, c in self._known.items() if now >= c.quiet_until)
        return list(found)

    def _room(self) -> bool:
        """A full table drops the client longest unheard that never speaks; those that speak are never dropped for a stranger."""
        if len(self._known) < _MOST:
            return True
        mute = [a for a, c in self._known.items() if not c.speaks]
        if mute:
            del self._known[min(mute, key=lambda a: self._known[a].heard)]
        return bool(mute)
