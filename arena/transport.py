"""UDP sockets and serial devices, and connection URLs such as `udpin:0.0.0.0:14540`.

    udpin:HOST:PORT        listen on HOST:PORT; the vehicle sends to it
    udpout:HOST:PORT       send to HOST:PORT
    serial:DEVICE[:BAUD]   a serial device

This module imports only the standard library, because `land-all` must start without any other package. It
imports pyserial only when a serial device is opened. It must not read or write MAVLink.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import ipaddress
import os
import socket
import struct
import termios
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from arena.errors import RunError

Address = tuple[str, int]
"""IPv4 host and UDP port."""
Source = Address | str
"""Source of received data: the UDP address of the sender, or the name of a serial device or link."""

DEFAULT_BAUD = 921_600
RECEIVE_BUFFER_BYTES = 1 << 20
MAX_DATAGRAM_BYTES = 1 << 16
MAX_DATAGRAMS_PER_READ = 64
EXPECTED_URL = (
    "udpin:HOST:PORT (the vehicle sends to us), udpout:HOST:PORT (we send to the vehicle) or serial:DEVICE[:BAUD], "
    "as in udpin:0.0.0.0:14540"
)

_SO_TIMESTAMPNS = 35  # asm-generic/socket.h; the socket module does not name it
_TIMESPEC = struct.Struct("@qq")
_STAMP_SPACE = socket.CMSG_SPACE(_TIMESPEC.size)
_STAMP_ERROR_S = 0.005  # between a stamp and the two clock readings that it is compared with
_CLOCK_STEP_S = 0.02  # a greater change of the wall clock against the monotonic clock is a step
_OFFSET_MEMORY_S = 10.0
_UNPLUGGED = (errno.EIO, errno.ENXIO, errno.ENODEV, errno.EBADF)
_MIN_BAUD = 300  # a shorter number after a device's name belongs to the name


def is_loopback(address: Address) -> bool:
    """Return whether an address is on this computer's loopback network."""
    return address[0].startswith("127.")


def source_text(source: Source | None) -> str:
    """Return the source of received data as text for the user, such as host:port; "" for None."""
    if source is None or isinstance(source, str):
        return source or ""
    return f"{source[0]}:{source[1]}"


# -- connection URLs -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ConnectionUrl:
    """UDP address or serial device of a connection, as parsed from a connection URL.

    kind: udpin and udpout have `host` and `port`; serial has `device` and `baud`.
    host: numeric IPv4 address
    baud: [bit/s]
    """

    kind: Literal["udpin", "udpout", "serial"]
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"{self.device} at {self.baud} baud"
        return f"{self.kind} {self.host}:{self.port}"

    @property
    def url(self) -> str:
        """Connection URL as written in the YAML.

        It has no baud rate, because the YAML has a separate key `baud`.
        """
        return f"serial:{self.device}" if self.kind == "serial" else f"{self.kind}:{self.host}:{self.port}"

    @property
    def address(self) -> Address:
        return self.host, self.port


def parse_url(url: str, *, baud: int = DEFAULT_BAUD) -> ConnectionUrl:
    """Parse a connection URL, such as `udpin:0.0.0.0:14540`.

    Raises ValueError, which lists the expected forms, for any other text.

    baud: baud rate of a serial URL that does not contain one [bit/s]
    """
    kind, _, rest = url.partition(":")
    if kind == "serial" and rest.startswith("/"):
        return _parse_serial(rest, baud)
    host, _, port = rest.rpartition(":")
    if not (port.isascii() and port.isdecimal()):
        raise ValueError(EXPECTED_URL)
    if kind == "udpin":
        return _udp_url("udpin", host, int(port))
    if kind == "udpout":
        return _udp_url("udpout", host, int(port))
    raise ValueError(EXPECTED_URL)


def url_from_json(raw: Mapping[str, Any]) -> ConnectionUrl:
    """Read a connection from the JSON configuration file (slice) of a process.

    The form is {kind, address} or {kind, device, baud}. Raises KeyError, TypeError or ValueError for another
    form.
    """
    kind = raw["kind"]
    if kind == "serial":
        return ConnectionUrl(kind="serial", device=str(raw["device"]), baud=int(raw["baud"]))
    if kind not in ("udpin", "udpout"):
        raise ValueError(f"kind of connection: got {kind!r}, expected udpin, udpout or serial")
    host, port = raw["address"]
    return _udp_url(kind, str(host), int(port))


def _parse_serial(rest: str, baud: int) -> ConnectionUrl:
    device, _, number = rest.rpartition(":")
    if device and number.isascii() and number.isdecimal() and int(number) >= _MIN_BAUD:
        return ConnectionUrl(kind="serial", device=device, baud=int(number))
    return ConnectionUrl(kind="serial", device=rest, baud=baud)


def _udp_url(kind: Literal["udpin", "udpout"], host: str, port: int) -> ConnectionUrl:
    """Parse the host (numeric IPv4 address) and the port of a UDP connection URL.

    Raises ValueError for a host name, and for a port that is not between 1 and 65535.
    A host name is refused, because a name lookup could block or fail without a network.
    """
    try:
        address = ipaddress.IPv4Address("127.0.0.1" if host == "localhost" else host)
    except ValueError as error:
        raise ValueError(f"{EXPECTED_URL}; HOST must be a numeric IPv4 address, got {host!r}") from error
    if not 1 <= port <= 65535:
        raise ValueError(f"{EXPECTED_URL}; PORT must be 1 to 65535, got {port}")
    if kind == "udpout" and (address.is_unspecified or address.is_multicast or host == "255.255.255.255"):
        raise ValueError(
            f"{EXPECTED_URL}; udpout:HOST must be the vehicle's own address, got the broadcast, multicast or wildcard address {host}"
        )
    return ConnectionUrl(kind=kind, host=str(address), port=port)


# -- UDP -------------------------------------------------------------------------------------------------------------------


def open_udp(
    local: Address | None = None, *, receive_buffer_bytes: int | None = RECEIVE_BUFFER_BYTES
) -> socket.socket:
    """Open a non-blocking IPv4 UDP socket.

    Raises OSError if the address cannot be bound.

    local: address to bind; None lets the kernel choose
    receive_buffer_bytes: large by default, so that no datagram is lost while the process is busy for a
    moment; None for the kernel's default
    """
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setblocking(False)
    if receive_buffer_bytes is not None:
        with contextlib.suppress(OSError):
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer_bytes)
    if local is not None:
        try:
            opened.bind(local)
        except OSError:
            opened.close()
            raise
    return opened


def listen_udp(
    local: Address, owner: str = "", *, receive_buffer_bytes: int = RECEIVE_BUFFER_BYTES
) -> socket.socket:
    """Open a UDP socket to receive. Raises RunError with a hint if the address cannot be bound.

    owner: process that needs the socket, the first words of the error message: "the router"
    """
    try:
        return open_udp(local, receive_buffer_bytes=receive_buffer_bytes)
    except OSError as error:
        problem = f"{owner} cannot listen" if owner else "cannot listen"
        hint = ". Does another program use this port?" if error.errno == errno.EADDRINUSE else ""
        raise RunError(f"{problem} on UDP {local[0]}:{local[1]}: {error.strerror}{hint}") from error


def receive_datagrams(
    source: socket.socket, limit: int = MAX_DATAGRAMS_PER_READ
) -> Iterator[tuple[bytes, Address]]:
    """Yield (datagram, sender) for each datagram that has arrived. Never waits.

    limit: maximum number of datagrams per call, so that a flood on one socket does not delay the other
    sockets
    Network errors (ICMP) about datagrams that were sent earlier are ignored.
    """
    for _ in range(limit):
        try:
            yield source.recvfrom(MAX_DATAGRAM_BYTES)
        except BlockingIOError:
            return
        except OSError:
            if source.fileno() < 0:  # closed between two datagrams
                return


# -- age of received datagrams ---------------------------------------------------------------------------------------------


class StampAges:
    """Computes the age of a datagram from its stamp, the time at which the kernel received it. Pure.

    The stamps are times of the wall clock, which may be set while datagrams wait. A stamp is therefore compared
    with every offset that the wall clock has recently had to the monotonic clock. If several ages are possible,
    the greatest is returned; if none is, the greatest age that the datagram can have.
    """

    def __init__(self, wall_s: float, now: float) -> None:
        self._offsets = [(wall_s - now, now)]

    def update(self, wall_s: float, now: float) -> None:
        """Record the present times of the wall clock and the monotonic clock, to detect when the wall clock is set.

        Call it a few times a second. wall_s: wall clock [s]. now: monotonic [s].
        """
        if abs(wall_s - now - self._offsets[-1][0]) < _CLOCK_STEP_S:
            self._offsets[-1] = wall_s - now, now
        else:
            self._offsets.append((wall_s - now, now))
        if len(self._offsets) > 1:
            self._offsets = [(o, at) for o, at in self._offsets if now - at <= _OFFSET_MEMORY_S]

    def age_s(self, stamp_s: float, wall_s: float, now: float, longest_s: float) -> float:
        """Return how long a datagram has waited since this computer received it [s].

        stamp_s: the kernel's receive stamp, wall clock [s]. longest_s: time since the socket was last empty [s],
        which limits the age of everything that waits in it.
        """
        ages = [now - (stamp_s - offset) for offset in (wall_s - now, *(o for o, _ in self._offsets))]
        possible = [age for age in ages if -_STAMP_ERROR_S <= age <= longest_s + _STAMP_ERROR_S]
        return min(max(0.0, *possible), longest_s) if possible else longest_s


def receive_stamped(source: socket.socket) -> tuple[bytes, Address, float | None]:
    """Receive one datagram with the time at which the kernel received it.

    Return (datagram, sender, stamp). The stamp is the wall-clock time of reception [s], None if the kernel gave none. Raises
    OSError.
    """
    data, ancillary, _, sender = source.recvmsg(MAX_DATAGRAM_BYTES, _STAMP_SPACE)
    for level, kind, value in ancillary:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(value) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(value)
            return data, sender, seconds + 1e-9 * nanoseconds
    return data, sender, None


def enable_stamps(source: socket.socket) -> None:
    """Make the kernel record when it receives each datagram (its stamp).

    `AgedSocket` computes the age of a datagram from its stamp.

    Some kernels have no such stamps. Then a datagram that waits is given the greatest age that it can have.
    """
    with contextlib.suppress(OSError):
        source.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)


class AgedSocket:
    """UDP socket that returns each datagram with its age: the time since this computer received it.

    ages: shared by all sockets of a process, which updates it a few times a second. now: monotonic [s].
    """

    def __init__(self, source: socket.socket, ages: StampAges, now: float) -> None:
        self._source, self._ages, self._empty_at = source, ages, now
        self.fileno, self.sendto, self.close = source.fileno, source.sendto, source.close
        enable_stamps(source)

    def on_empty(self, now: float) -> None:
        """Record the time at which all datagrams were read from the socket: later datagrams cannot be older.

        now: monotonic [s].
        """
        self._empty_at = now

    def receive(self, limit: int = MAX_DATAGRAMS_PER_READ) -> Iterator[tuple[bytes, Address, float]]:
        """Yield (datagram, sender, age [s]) for each datagram that has arrived. Never waits."""
        for _ in range(limit):
            began = time.monotonic()
            try:
                data, sender, stamp_s = receive_stamped(self._source)
            except BlockingIOError:
                return self.on_empty(began)
            except OSError:
                if self._source.fileno() < 0:  # closed between two datagrams
                    return
                continue
            now, wall_s = time.monotonic(), time.time()
            longest_s = now - self._empty_at
            age_s = longest_s if stamp_s is None else self._ages.age_s(stamp_s, wall_s, now, longest_s)
            yield data, sender, age_s


# -- serial devices --------------------------------------------------------------------------------------------------------


class SerialPort:
    """Serial device, opened in raw, non-blocking mode.

    Raises OSError if the device cannot be opened; its text says what to do.
    """

    def __init__(self, device: str, baud: int) -> None:
        try:
            import serial
        except ImportError as error:
            raise OSError(
                f"{device} cannot be opened: pyserial is not installed. Run `pip install pyserial`"
            ) from error
        try:
            self._port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
            self._fd = int(self._port.fileno())
            os.set_blocking(self._fd, False)
            attributes = termios.tcgetattr(self._fd)
            attributes[6][termios.VMIN] = 1  # a read of no bytes then means that the device has hung up
            termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            raise OSError(_open_failure(device, baud, error)) from error

    def fileno(self) -> int:
        return self._fd

    def read(self, limit: int = 1 << 14) -> bytes | None:
        """Return the bytes that have arrived; None if no bytes have arrived.

        Raises OSError; `is_unplugged` returns whether the device was unplugged.
        """
        try:
            data = os.read(self._fd, limit)
        except BlockingIOError:
            return None
        if not data:
            raise OSError(errno.ENXIO, os.strerror(errno.ENXIO))
        return data

    def write(self, data: bytes) -> int:
        """Write bytes to the serial device. Return how many bytes the driver accepted.

        Raises OSError if the device was unplugged.
        """
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0

    def unsent_bytes(self) -> int:
        """Return the number of bytes in the driver's send queue; 0 if the driver does not report it."""
        try:
            return int(struct.unpack("i", fcntl.ioctl(self._fd, termios.TIOCOUTQ, b"\0\0\0\0"))[0])
        except OSError:
            return 0

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()


def is_unplugged(error: OSError) -> bool:
    """Return whether an error of a serial device means that the device was unplugged."""
    return error.errno in _UNPLUGGED


def _open_failure(device: str, baud: int, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"there is no {device}: is the cable in, and the vehicle powered? `ls /dev/serial/by-id` lists the devices"
    if number in (errno.EACCES, errno.EPERM):
        return f"no permission to open {device}: `sudo usermod -aG dialout $USER`, then log in again"
    if number in (errno.EBUSY, errno.EAGAIN) or "lock" in str(error):
        return f"{device} is in use by another program: close the ground station (or ModemManager) that has it open"
    return f"{device} cannot be opened at {baud} baud: {error}"
