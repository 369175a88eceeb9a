"""The shells of the wire: a UDP socket or a serial device, each with what it takes to begin again when it is gone."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import struct
import termios
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from arena.errors import RunError
from arena.fcu_link.core import Link
from arena.fcu_link.peer import Partner
from arena.fcu_link.settings import Wire as WireSettings
from arena.wire.mavlink_frame import Buffer, Cut, Frame, Stream, cut

_BUFFER_BYTES = 1 << 20
_READ_BYTES = 65535
_MOST = 64  # datagrams or pieces at a look, so that a flood starves nobody
_AGAIN_S = 1.0
_AHEAD_S = 0.01  # of bytes in the driver's queue: what waits there cannot be overtaken
_AHEAD_BYTES = 300
_TO_UNPLUGGED = (errno.EIO, errno.ENXIO, errno.ENODEV, errno.EBADF)

Next = Callable[[], bytes | None]


class Wire(Protocol):
    """Read with `read`, when `fileno` is ready or a tick has come; write with `write`, which takes frames while they fit."""

    events: list[str]

    def fileno(self) -> int | None:
        """None while there is nothing to wait on."""

    def read(self, now: float) -> Iterator[tuple[Buffer, Cut]]:
        """What has come from the vehicle."""

    def write(self, take: Next, now: float) -> bool:
        """False while the wire is away, or nobody is there to send to. take: the next frame, None when none waits."""

    def wants_write(self) -> bool:
        """Is something half written?"""

    def tick(self, now: float) -> None: ...

    def partner(self) -> str: ...

    def place(self) -> dict[str, Any]:
        """Where the vehicle is to be found by who must speak to it without us, as JSON."""

    def close(self) -> None: ...


def open_wire(wire: WireSettings, core: Link, now: float) -> Wire:
    """core: knows the vehicle's voice, and keeps the counts."""
    return SerialWire(wire, now) if wire.kind == "serial" else UdpWire(wire, core)


class UdpWire:
    """udpin: bound, and learns who its partner is. udpout: speaks first, and hears that address alone."""

    def __init__(self, wire: WireSettings, core: Link) -> None:
        self.events: list[str] = []
        self._kind, self._fixed = wire.kind, wire.address if wire.kind == "udpout" else None
        self._core = core
        self._learned = Partner()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        if self._fixed is None:
            self._bind(wire.address)

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def read(self, now: float) -> Iterator[tuple[Buffer, Cut]]:
        for _ in range(_MOST):
            try:
                data, sender = self._socket.recvfrom(_READ_BYTES)
            except BlockingIOError:
                return
            except OSError:  # the network's answer to something sent before
                continue
            found = cut(data)
            if self._is_from_partner(sender, found.frames, now):
                yield data, found
            else:
                self._core.overheard(data, found)

    def write(self, take: Next, now: float) -> bool:
        to = self._fixed or self._learned.address
        if to is None:
            return False
        while (frame := take()) is not None:
            try:
                self._socket.sendto(frame, to)
            except OSError:  # a full queue, or a network that is away: the next will be newer
                self._core.counts["to the vehicle: not sent"] += 1
        return True

    def wants_write(self) -> bool:
        return False

    def tick(self, now: float) -> None:
        self.events += self._learned.events
        self._learned.events.clear()

    def partner(self) -> str:
        to = self._fixed or self._learned.address
        return f"{to[0]}:{to[1]}" if to else ""

    def place(self) -> dict[str, Any]:
        to = self._fixed or self._learned.address
        local = list(self._socket.getsockname())
        return {"kind": self._kind, "local": local if local[1] else None, "vehicle": list(to) if to else None}

    def close(self) -> None:
        self._socket.close()

    def _is_from_partner(self, sender: tuple[str, int], frames: list[Frame], now: float) -> bool:
        if self._fixed is not None:
            return sender == self._fixed
        return self._learned.accepts(sender, self._core.speaks_here(frames), now)

    def _bind(self, address: tuple[str, int]) -> None:
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            hint = (
                " Does a ground station or another arena listen there?"
                if error.errno == errno.EADDRINUSE
                else ""
            )
            raise RunError(
                f"cannot listen for the vehicle on UDP {address[0]}:{address[1]}: {error.strerror}.{hint}"
            ) from error


class SerialWire:
    """A device that may be absent, refused, unplugged in flight and back: told once each time, tried again every second."""

    def __init__(self, wire: WireSettings, now: float) -> None:
        self.events: list[str] = []
        self._wire, self._device = wire, wire.device
        self._ahead = max(_AHEAD_BYTES, int(wire.baud / 10 * _AHEAD_S))
        self._port: Any = None
        self._stream = Stream()
        self._half = b""
        self._told = ""
        self._next_open = now
        self.tick(now)

    def fileno(self) -> int | None:
        return None if self._port is None else int(self._port.fileno())

    def read(self, now: float) -> Iterator[tuple[Buffer, Cut]]:
        for _ in range(_MOST):
            if self._port is None:
                return
            try:
                data = os.read(self._port.fileno(), 4096)
            except BlockingIOError:
                return
            except OSError as error:
                return self._gone(error, now)
            if not data:
                return self._gone(None, now)
            yield self._stream.feed(data)

    def write(self, take: Next, now: float) -> bool:
        if self._port is None:
            return False
        try:
            while self._ahead_bytes() < self._ahead and (frame := self._half or take()):
                self._half = frame[self._put(frame) :]
                if self._half:
                    break
        except OSError as error:
            self._gone(error, now)
        return True

    def wants_write(self) -> bool:
        return bool(self._half)

    def tick(self, now: float) -> None:
        if self._port is None and now >= self._next_open:
            self._next_open = now + _AGAIN_S
            self._open()

    def partner(self) -> str:
        return self._device if self._port is not None else ""

    def place(self) -> dict[str, Any]:
        return {"kind": "serial", "device": self._device, "baud": self._wire.baud}

    def close(self) -> None:
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.close()
            self._port = None

    def _put(self, data: bytes) -> int:
        try:
            return os.write(self._port.fileno(), data)
        except BlockingIOError:
            return 0

    def _ahead_bytes(self) -> int:
        """In the driver, not yet on the wire; 0 where it does not tell."""
        try:
            return int(struct.unpack("i", fcntl.ioctl(self._port.fileno(), termios.TIOCOUTQ, b"\0\0\0\0"))[0])
        except OSError:
            return 0

    def _open(self) -> None:
        import serial

        try:
            self._port = serial.Serial(
                self._device, self._wire.baud, timeout=0, write_timeout=0, exclusive=True
            )
            _without_waiting(self._port.fileno())
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            self._port = None
            return self._tell(_why_closed(self._device, self._wire.baud, error))
        self._stream, self._half = Stream(), b""
        self._tell(f"{self._device} is open at {self._wire.baud} baud")

    def _gone(self, error: OSError | None, now: float) -> None:
        self.close()
        self._next_open = now + _AGAIN_S
        what = "has gone" if error is None or error.errno in _TO_UNPLUGGED else f"failed ({error.strerror})"
        ask = "is the cable still in, and the vehicle powered? It is opened again as soon as it is back"
        self._tell(f"{self._device} {what}: {ask}")

    def _tell(self, text: str) -> None:
        """When it changes."""
        if text != self._told:
            self._told = text
            self.events.append(text)


def _without_waiting(fd: int) -> None:
    """Reads that find nothing say so, so that one of no bytes means that the device has hung up."""
    os.set_blocking(fd, False)
    attributes = termios.tcgetattr(fd)
    attributes[6][termios.VMIN] = 1
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def _why_closed(device: str, baud: int, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"there is no {device}: is the cable in, and the vehicle powered? `ls /dev/serial/by-id` shows what is there"
    if number in (errno.EACCES, errno.EPERM):
        return f"{device} may not be opened by this user: `sudo usermod -aG dialout $USER`, then log in again"
    if number in (errno.EBUSY, errno.EAGAIN) or "lock" in str(error):
        return f"{device} is held by another program: close the ground station (or ModemManager) that has it open"
    return f"{device} cannot be opened at {baud} baud: {error}"
