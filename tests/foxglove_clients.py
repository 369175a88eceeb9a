"""Plain WebSocket clients of the server for Foxglove: one that reads, and one that reads nothing after its subscription."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

PROTOCOL = "foxglove.sdk.v1"
DEADLINE_S = 60.0
_MESSAGE, _TIME = 1, 2  # operation codes of binary messages
_KEY = "dGhlIHNhbXBsZSBub25jZQ=="


class LiveMessage(NamedTuple):
    """Binary message of the server. topic: "" for the time of the server.  log_time: [ns].  data: content."""

    topic: str
    log_time: int
    data: bytes


class Client:
    """Client that is connected. info: description of the server.  topics: name -> number of each advertised topic."""

    def __init__(self, host: str, port: int) -> None:
        url = f"ws://{host}:{port}"
        self.connection = connect(url, subprotocols=[Subprotocol(PROTOCOL)], max_size=None)
        self.info: dict[str, Any] = self._text()
        self.topics: dict[str, int] = {}
        self._names: dict[int, str] = {}
        self._read_topics()

    def _text(self) -> dict[str, Any]:
        """Return the next text message. The time of the server, a binary message, can come between two of them."""
        while isinstance(data := self.connection.recv(timeout=DEADLINE_S), bytes):
            assert data[0] == _TIME
        found: dict[str, Any] = json.loads(data)
        return found

    def _read_topics(self) -> None:
        for channel in self._text().get("channels", ()):
            self.topics[channel["topic"]] = int(channel["id"])
            self._names[int(channel["id"])] = channel["topic"]

    def subscribe(self, *topics: str) -> None:
        """Subscribe to topics. The server advertises its topics one by one while it starts."""
        while not set(topics) <= set(self.topics):
            self._read_topics()
        self.connection.send(_subscription([self.topics[topic] for topic in topics]))

    def received(self, timeout_s: float) -> Iterator[LiveMessage]:
        """Yield messages until none arrives for `timeout_s` [s], or the server ends."""
        while True:
            try:
                data = self.connection.recv(timeout=timeout_s)
            except (TimeoutError, ConnectionClosed):
                return
            if not isinstance(data, bytes):
                continue
            if data[0] == _TIME:
                yield LiveMessage("", struct.unpack_from("<Q", data, 1)[0], b"")
            elif data[0] == _MESSAGE:
                number, log_time = struct.unpack_from("<IQ", data, 1)
                yield LiveMessage(self._names[number], log_time, data[13:])

    def close(self) -> None:
        self.connection.close()


def hung_client(host: str, port: int, numbers: Collection[int]) -> socket.socket:
    """Return a connection that has subscribed to topics and reads nothing. numbers: numbers of the topics."""
    assert numbers
    raw = socket.create_connection((host, port))
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    raw.sendall(
        f"GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {_KEY}\r\n"
        f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: {PROTOCOL}\r\n\r\n".encode()
    )
    text = _subscription(numbers).encode()
    mask = bytes(4)
    raw.sendall(b"\x81\xfe" + struct.pack(">H", len(text)) + mask + text)
    return raw


def _subscription(numbers: Collection[int]) -> str:
    wanted = [{"id": number, "channelId": number} for number in numbers]
    return json.dumps({"op": "subscribe", "subscriptions": wanted})
