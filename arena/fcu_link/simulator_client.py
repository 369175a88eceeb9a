"""The shell towards the world's simulator port, for a controller in the loop: a TCP client, as a PX4 SITL is one."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections import Counter
from collections.abc import Iterator

from arena.transport import Address
from arena.wire.mavlink_frame import Buffer, ParsedFrames, Stream

_AGAIN_S = 0.5
_PATIENCE = 10
_READ_BYTES = 65536
_MOST = 16


class World:
    """Connected only while the vehicle is heard: a controller that has gone must not keep its motors turning in the world."""

    def __init__(self, address: Address, counts: Counter[str], greeting: bytes) -> None:
        self.events: list[str] = []
        self._address, self._counts, self._greeting = address, counts, greeting
        self._socket: socket.socket | None = None
        self._connected = False
        self._stream = Stream()
        self._next_try = -1e9
        self._refusals = 0

    def fileno(self) -> int | None:
        return None if self._socket is None else self._socket.fileno()

    @property
    def connected(self) -> bool:
        return self._connected

    def tick(self, wanted: bool, now: float) -> None:
        """wanted: is there a controller to connect?"""
        if not wanted:
            if self._connected:
                self.events.append("its controller is silent: taken out of the world until it speaks again")
            self.close()
        elif self._socket is None and now >= self._next_try:
            self._next_try = now + _AGAIN_S
            self._begin()
        elif self._socket is not None and not self._connected:
            self._finish()

    def read(self) -> Iterator[tuple[Buffer, ParsedFrames]]:
        for _ in range(_MOST):
            if self._socket is None or not self._connected:
                return
            try:
                data = self._socket.recv(_READ_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                return self._gone()
            yield self._stream.feed(data)

    def write(self, data: bytes) -> None:
        """Whole frames, or none: half a one would spoil the next."""
        if self._socket is None or not self._connected:
            return
        try:
            if self._socket.send(data) != len(data):
                self._gone()
        except BlockingIOError:
            self._counts["to the simulator: it does not read"] += 1
        except OSError:
            self._gone()

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._connected = None, False

    def _begin(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        number = self._socket.connect_ex(self._address)
        if number not in (0, errno.EINPROGRESS):
            return self._refused(number)
        self._finish()

    def _finish(self) -> None:
        assert self._socket is not None
        number = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if number:
            return self._refused(number)
        try:
            self._socket.getpeername()
        except OSError:  # still under way
            return
        self._connected, self._stream, self._refusals = True, Stream(), 0
        self.write(self._greeting)  # the world takes for a controller who has spoken
        self.events.append(f"connected to the world at {self._address[0]}:{self._address[1]}")

    def _refused(self, number: int) -> None:
        """The world is not there yet, or is being restarted: tried again, and told once."""
        self.close()
        self._refusals += 1
        if self._refusals == _PATIENCE:
            self.events.append(
                f"cannot reach the world at {self._address[0]}:{self._address[1]}: {os.strerror(number)}"
            )

    def _gone(self) -> None:
        self.close()
        self.events.append("the world has closed the simulator link: connecting again")
