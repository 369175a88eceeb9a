"""List of the clients to which the NatNet emulator sends frames by unicast. Pure.

Times are wall time [s]. Clients differ in the port that they listen on. Some listen on the port from which
they send requests, others on the data port, without announcing it. Only some clients send keepalives.
Therefore a client that stops sending is removed only if it has sent keepalives before.
"""

from __future__ import annotations

from dataclasses import dataclass

from arena.mocap.natnet import codec
from arena.transport import Address

_SILENT_S = 10.0
_QUIET_S = 0.5  # after CONNECT, no frames to the requesting port: the next packet there must be the answer to its next request
_MAX_CLIENTS = 64


@dataclass(slots=True)
class _Client:
    """State of one client that receives frames by unicast.

    All times are wall time [s].

    last_request: time of the client's last request.
    quiet_until: until this time, no frames are sent to the port from which the client sends its requests.
    keepalives: whether the client has sent a keepalive.
    """

    last_request: float
    quiet_until: float
    keepalives: bool = False


class UnicastClients:
    """List of the clients that receive frames by unicast, with the addresses to send frames to.

    data_port: UDP port to which frames are sent, in addition to the port from which a client sends its requests.
    """

    def __init__(self, data_port: int) -> None:
        self._data_port = data_port
        self._clients: dict[Address, _Client] = {}

    def on_request(self, message: int, sender: Address, now: float) -> None:
        """Update the list of clients after a client's request, such as connect or disconnect.

        Call this before the request is answered.
        """
        if message == codec.DISCONNECT:
            self._clients.pop(sender, None)
        elif message in (codec.CONNECT, codec.KEEPALIVE) and (sender in self._clients or self._make_room()):
            client = self._clients.setdefault(sender, _Client(now, now))
            client.last_request = now
            client.keepalives |= message == codec.KEEPALIVE
            if message == codec.CONNECT:
                client.quiet_until = now + _QUIET_S
        elif message == codec.REQUEST_MODELDEF and sender in self._clients:
            self._clients[sender].last_request = self._clients[sender].quiet_until = now

    def destinations(self, now: float) -> list[Address]:
        """Remove silent clients, and return the addresses to which frames are sent.

        For each client, these are the data port of its host and the port from which it sends its requests.
        """
        gone = [a for a, c in self._clients.items() if c.keepalives and now - c.last_request >= _SILENT_S]
        for address in gone:
            del self._clients[address]
        found = dict.fromkeys((host, self._data_port) for host, _ in self._clients)
        found |= dict.fromkeys(a for a, c in self._clients.items() if now >= c.quiet_until)
        return list(found)

    def _make_room(self) -> bool:
        """Remove a client from a full list, so that a new one can be added. Return False if the list stays full.

        Only clients that never sent a keepalive are removed, the longest silent one first.
        """
        if len(self._clients) < _MAX_CLIENTS:
            return True
        mute = [a for a, c in self._clients.items() if not c.keepalives]
        if mute:
            del self._clients[min(mute, key=lambda a: self._clients[a].last_request)]
        return bool(mute)
