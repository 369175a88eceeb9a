"""Connections to vehicles for parameter transfers, by UDP or serial device. They carry MAVLink frames."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

from arena.errors import InputError, RunError
from arena.signing_key import TimestampFile, read_key
from arena.transport import MAX_DATAGRAMS_PER_READ, Address, SerialPort, open_udp, receive_datagrams
from arena.wire.mavlink_frame import Buffer, Frame, Stream, parse_frames
from arena.wire.mavlink_signing import PARAMS, SignedConnection


@dataclass(frozen=True, kw_only=True)
class ParamTarget:
    """Address of a vehicle for a parameter transfer: a UDP address or a serial device.

    system: MAVLink system id.
    remote: (host, port) of the vehicle, the only accepted sender; None: the first sender with this system id.
    local: (host, port) to bind on this computer; None: any.
    uid: hardware uid of the vehicle in hexadecimal digits; "none": it reports no uid; "": any.
    key_file: file with the key of MAVLink signing; "": messages are not signed.
    device, baud: path and baud rate of a serial device; if it is given, the UDP addresses are not used.
    """

    system: int
    remote: Address | None = None
    local: Address | None = None
    device: str = ""
    baud: int = 57600
    uid: str = ""
    key_file: str = ""


class ParamTransport(Protocol):
    """Interface of a connection to one vehicle that sends and receives MAVLink frames."""

    def fileno(self) -> int: ...

    def read(self) -> Iterator[tuple[Buffer, list[Frame]]]:
        """Yield (received bytes, MAVLink frames in them) for all data sent by the vehicle. Never blocks."""

    def send(self, frame: bytes) -> None:
        """Send a MAVLink frame. A frame that cannot be sent now is dropped.

        Every request is repeated later.
        """

    def close(self) -> None: ...


class UdpParamTransport:
    """UDP connection to a vehicle.

    Without a fixed remote address, the first sender with the vehicle's system id is used.

    Raises RunError if the local address cannot be bound.
    """

    def __init__(self, target: ParamTarget) -> None:
        self._remote, self._system = target.remote, target.system
        try:
            self._socket = open_udp(target.local)
        except OSError as error:
            host, port = target.local or ("", 0)
            raise RunError(
                f"cannot listen on UDP {host}:{port}: {error.strerror}. Does another program use this port?"
            ) from error

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> Iterator[tuple[Buffer, list[Frame]]]:
        for data, sender in receive_datagrams(self._socket):
            frames = parse_frames(data).frames
            if self._remote is None and any(frame.sysid == self._system for frame in frames):
                self._remote = sender
            if sender == self._remote:
                yield data, frames

    def send(self, frame: bytes) -> None:
        if self._remote is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(frame, self._remote)

    def close(self) -> None:
        self._socket.close()


class SerialParamTransport:
    """Serial connection to a vehicle. Raises RunError if the device cannot be opened."""

    def __init__(self, target: ParamTarget) -> None:
        try:
            self._port = SerialPort(target.device, target.baud)
        except OSError as error:
            raise RunError(str(error)) from error
        self._stream = Stream()

    def fileno(self) -> int:
        return self._port.fileno()

    def read(self) -> Iterator[tuple[Buffer, list[Frame]]]:
        for _ in range(MAX_DATAGRAMS_PER_READ):
            try:
                data = self._port.read()
            except OSError:  # the device was unplugged; the time-out of the vehicle will end the transfer
                return
            if data is None:
                return
            buffer, found = self._stream.feed(data)
            yield buffer, found.frames

    def send(self, frame: bytes) -> None:
        with contextlib.suppress(OSError):
            self._port.write(frame)

    def close(self) -> None:
        self._port.close()


class SignedParamTransport:
    """Connection to a vehicle with MAVLink message signing.

    The connection signs frames to the vehicle, and ignores frames without a valid signature.
    """

    def __init__(self, inner: ParamTransport, key: bytes, key_file: str) -> None:
        self._inner, self._timestamps = inner, TimestampFile(key_file)
        self._signed = SignedConnection(key, PARAMS, self._timestamps.first())

    def fileno(self) -> int:
        return self._inner.fileno()

    def read(self) -> Iterator[tuple[Buffer, list[Frame]]]:
        for data, frames in self._inner.read():
            yield data, self._signed.accepted(data, frames, time.time())

    def send(self, frame: bytes) -> None:
        self._timestamps.save(self._signed.timestamp, time.monotonic())
        if (signed := self._signed.sign(frame, time.time())) is not None:
            self._inner.send(signed)

    def close(self) -> None:
        self._timestamps.write(self._signed.timestamp)
        self._inner.close()


def open_transport(target: ParamTarget) -> ParamTransport:
    """Open the UDP or serial connection to a vehicle.

    Raises RunError if the address is in use, or the device or the signing key cannot be opened.
    """
    if not target.key_file:
        return SerialParamTransport(target) if target.device else UdpParamTransport(target)
    try:
        key = read_key(target.key_file)
    except InputError as error:
        raise RunError(str(error)) from error
    return SignedParamTransport(open_transport(replace(target, key_file="")), key, target.key_file)
