"""Connections to the flight controller: a UDP socket or a serial device.

A serial device is opened again after it was unplugged.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from arena.errors import RunError
from arena.fcu_link.core import FcuLink
from arena.transport import (
    MAX_DATAGRAMS_PER_READ,
    Address,
    ConnectionUrl,
    SerialPort,
    Source,
    is_unplugged,
    open_udp,
    receive_datagrams,
    source_text,
)
from arena.wire.mavlink_frame import Buffer, ParsedFrames, Stream, parse_frames

_REOPEN_S = 1.0
_RELEASE_TIMEOUT_S = 2.0
"""Longest wait until land-all, which has served the vehicle while no link process ran, releases the UDP port [s]."""
_RELEASE_POLL_S = 0.02
_QUEUE_S = 0.01  # data that the serial driver may hold: a more urgent frame cannot overtake it
_MIN_QUEUE_BYTES = 300

NextFrame = Callable[[], bytes | None]


class FcuTransport(Protocol):
    """Interface of a connection to the flight controller (UDP or serial device).

    Call `read` when `fileno` is readable and at every tick, `write` when frames wait, `tick` a few times a
    second.
    events: messages for the user; the caller takes them and empties the list
    """

    events: list[str]

    def fileno(self) -> int | None:
        """Return the file descriptor of the connection, for `poll`; None if the device is absent."""

    def read(self, now: float) -> Iterator[tuple[Source, Buffer, ParsedFrames]]:
        """Yield the data that have arrived, with the source of each item. Never waits."""

    def request(self, source: Source, frame: bytes) -> None:
        """Send a request for the hardware uid to one vehicle.

        It is sent before the frames that wait in the queue.
        """

    def write(self, next_frame: NextFrame, now: float) -> bool:
        """Send frames until the operating system accepts no more.

        Return False if the device is absent or the vehicle's address is unknown.

        next_frame: returns the next frame to send; None if there is none
        """

    def wants_write(self) -> bool:
        """Return whether a frame was written in part, so that its other bytes must still be written."""

    def tick(self, now: float) -> None: ...

    def peer(self) -> str:
        """Return the vehicle's address or device as text for the user; "" if unknown."""

    def last_address(self) -> dict[str, Any]:
        """Return the last known address of the vehicle as JSON, for `land-all`."""

    def close(self) -> None: ...


def open_transport(connection: ConnectionUrl, core: FcuLink, now: float) -> FcuTransport:
    """Open the connection to the flight controller.

    Raises RunError if a UDP port cannot be bound.

    core: recognises the vehicle by its hardware uid, and counts frames of other senders
    A serial device may be absent: it is opened when it appears.
    """
    if connection.kind == "serial":
        return SerialTransport(connection, core, now)
    return UdpTransport(connection, core)


class UdpTransport:
    """Connection to the flight controller by UDP.

    A `udpin` URL opens a bound socket, and sends to the address of the vehicle that the core has accepted. A
    `udpout` URL sends to one address and accepts only data from it.
    """

    def __init__(self, connection: ConnectionUrl, core: FcuLink) -> None:
        self.events: list[str] = []
        self._kind, self._core = connection.kind, core
        self._fixed = connection.address if connection.kind == "udpout" else None
        try:
            self._socket = open_udp(None) if self._fixed else _open_when_released(connection.address)
        except OSError as error:
            in_use = error.errno == errno.EADDRINUSE
            hint = " Does a ground station or another arena listen there?" if in_use else ""
            where = f"{connection.host}:{connection.port}"
            raise RunError(
                f"cannot listen for the vehicle on UDP {where}: {error.strerror}.{hint}"
            ) from error

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def read(self, now: float) -> Iterator[tuple[Source, Buffer, ParsedFrames]]:
        for data, sender in receive_datagrams(self._socket):
            found = parse_frames(data)
            if self._fixed in (None, sender):
                yield sender, data, found
            else:
                self._core.on_foreign_datagram(data, found)

    def request(self, source: Source, frame: bytes) -> None:
        with contextlib.suppress(OSError):  # it is repeated
            if isinstance(source, tuple):
                self._socket.sendto(frame, source)

    def write(self, next_frame: NextFrame, now: float) -> bool:
        to = self._fixed or self._core.identity.source
        if not isinstance(to, tuple):
            return False
        while (frame := next_frame()) is not None:
            try:
                self._socket.sendto(frame, to)
            except OSError:  # full queue or no network: drop it, the next frame is newer
                self._core.counts["to the vehicle: not sent"] += 1
        return True

    def wants_write(self) -> bool:
        return False

    def tick(self, now: float) -> None:
        """Do nothing: a UDP socket, unlike a serial device, is never opened again."""

    def peer(self) -> str:
        return source_text(self._fixed or self._core.identity.source)

    def last_address(self) -> dict[str, Any]:
        to = self._fixed or self._core.identity.last_source
        local = list(self._socket.getsockname())
        return {"kind": self._kind, "local": local if local[1] else None, "vehicle": list(to) if to else None}

    def close(self) -> None:
        self._socket.close()


def _open_when_released(local: Address) -> socket.socket:
    """Open a UDP socket. If its port is in use, try again for _RELEASE_TIMEOUT_S.

    Raises OSError.
    """
    end = time.monotonic() + _RELEASE_TIMEOUT_S
    while True:
        try:
            return open_udp(local)
        except OSError as error:
            if error.errno != errno.EADDRINUSE or time.monotonic() >= end:
                raise
        time.sleep(_RELEASE_POLL_S)


class SerialTransport:
    """Connection to the flight controller by serial device.

    If the device is absent, unplugged or cannot be opened, the connection tries again later.

    Each change is reported once. Opening is retried every second.
    """

    def __init__(self, connection: ConnectionUrl, core: FcuLink, now: float) -> None:
        self.events: list[str] = []
        self._core, self._requests = core, deque[bytes]()
        self._connection, self._device = connection, connection.device
        self._queue_bytes = max(_MIN_QUEUE_BYTES, int(connection.baud / 10 * _QUEUE_S))
        self._port: SerialPort | None = None
        self._stream = Stream()
        self._half_written = b""
        self._last_event = ""
        self._next_open = now
        self.tick(now)

    def fileno(self) -> int | None:
        return None if self._port is None else self._port.fileno()

    def read(self, now: float) -> Iterator[tuple[Source, Buffer, ParsedFrames]]:
        for _ in range(MAX_DATAGRAMS_PER_READ):
            if self._port is None:
                return
            try:
                data = self._port.read(4096)
            except OSError as error:
                return self._on_lost(error, now)
            if data is None:
                return
            yield self._device, *self._stream.feed(data)

    def request(self, source: Source, frame: bytes) -> None:
        self._requests.append(frame)

    def write(self, next_frame: NextFrame, now: float) -> bool:
        port = self._port
        if port is None:
            return False
        try:
            while port.unsent_bytes() < self._queue_bytes and (frame := self._next(next_frame)):
                self._half_written = frame[port.write(frame) :]
                if self._half_written:
                    break
        except OSError as error:
            self._on_lost(error, now)
        return True

    def wants_write(self) -> bool:
        return bool(self._half_written)

    def tick(self, now: float) -> None:
        if self._port is None and now >= self._next_open:
            self._next_open = now + _REOPEN_S
            self._open()

    def peer(self) -> str:
        return self._device if self._port is not None else ""

    def last_address(self) -> dict[str, Any]:
        return {"kind": "serial", "device": self._device, "baud": self._connection.baud}

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def _next(self, next_frame: NextFrame) -> bytes | None:
        return self._half_written or (self._requests.popleft() if self._requests else next_frame())

    def _open(self) -> None:
        try:
            self._port = SerialPort(self._device, self._connection.baud)
        except OSError as error:
            return self._report(str(error))
        self._stream, self._half_written = Stream(), b""
        self._requests.clear()
        self._core.on_opened()
        self._report(f"{self._device} is open at {self._connection.baud} baud")

    def _on_lost(self, error: OSError, now: float) -> None:
        self.close()
        self._next_open = now + _REOPEN_S
        what = "is gone" if is_unplugged(error) else f"failed ({error.strerror})"
        ask = "is the cable in, and the vehicle powered? The device is opened as soon as it is available"
        self._report(f"{self._device} {what}: {ask}")

    def _report(self, text: str) -> None:
        """Add an event for the user, unless the last event has the same text."""
        if text != self._last_event:
            self._last_event = text
            self.events.append(text)
