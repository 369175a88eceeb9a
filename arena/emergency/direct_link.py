"""DirectLink to a real vehicle: beside its `link.<v>`, which goes on; in its place once that is dead, or reads no more.

A link that reads is never ended: then it is the vehicle that is silent, and the link is what will hear it first.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Callable, Iterator
from typing import Any

from arena.emergency.direct_address import Address, Wire
from arena.emergency.link_process import end, waiting_bytes
from arena.wire.mavlink_frame import Stream, cut

BESIDE_S = 0.5
SILENT_S = 1.0
_LOOK_S, _AGAIN_S = 0.1, 0.5
_DATAGRAM_BYTES = 1 << 16
_AT_A_TIME = 64
_AUTOPILOT = 1


class DirectLink:
    """Ask `step` and `send` as often as the other ways are used; read when one of `files` is ready."""

    def __init__(
        self, wire: Wire, *, name: str, system: int, door: Address, say: Callable[[str], None]
    ) -> None:
        """door: where its link hears land-all.  system: the vehicle's id."""
        self._wire, self._name, self._system, self._door, self._say = wire, name, system, door, say
        self._to = wire.vehicle
        self._beside: socket.socket | None = None
        self._place: socket.socket | None = None
        self._device: Any = None
        self._stream = Stream()
        self._unread_since: float | None = None
        self._next_look = self._next_try = 0.0
        self._told: set[str] = set()

    def step(self, silent_s: float, now: float) -> None:
        """silent_s: since the vehicle was last heard, or since we began [s]."""
        if self._in_place or now < self._next_look:
            return
        self._next_look = now + _LOOK_S
        waiting = waiting_bytes(self._door)
        if waiting is None:
            self._take(now, f"{self._holder} is gone")
            return
        self._unread_since = (
            None if not waiting else now if self._unread_since is None else self._unread_since
        )
        if silent_s >= BESIDE_S and self._beside is None and self._to is not None:
            self._beside = _udp()
            self._tell(f"not heard; speaking straight to {self._to[0]}:{self._to[1]} too")
        if silent_s >= SILENT_S and self._unread_since is not None and now - self._unread_since >= SILENT_S:
            self._end_holder(now)

    def send(self, frame: bytes) -> None:
        """A frame on the way that is open, if one is."""
        with contextlib.suppress(OSError):  # tried again
            if self._device is not None:
                os.write(self._device.fileno(), frame)
            elif (sock := self._place or self._beside) is not None and self._to is not None:
                sock.sendto(frame, self._to)

    def files(self) -> list[int]:
        held = (self._place, self._beside, self._device)
        return [file.fileno() for file in held if file is not None]

    def read(self, fd: int) -> Iterator[bytes]:
        """What the vehicle has said there, as whole frames."""
        if self._device is not None and fd == self._device.fileno():
            yield from self._read_device()
        for sock in (self._place, self._beside):
            if sock is not None and sock.fileno() == fd:
                yield from self._read_socket(sock)

    def close(self) -> None:
        for file in (self._place, self._beside, self._device):
            if file is not None:
                file.close()

    @property
    def _in_place(self) -> bool:
        return self._place is not None or self._device is not None

    @property
    def _holder(self) -> str:
        return f"link.{self._name}"

    def _end_holder(self, now: float) -> None:
        owner = self._wire.owner
        if owner is None:
            self._tell(
                f"{self._holder} does not read, and no run folder tells which process it is: give --run"
            )
        elif end(owner):
            self._take(
                now, f"{self._holder} (process {owner.pid}) did not read for {SILENT_S:g} s and was ended"
            )
        else:
            self._tell(f"{self._holder} (process {owner.pid}) does not read, and may not be ended")

    def _take(self, now: float, why: str) -> None:
        """Its place: the UDP port that it listened on, or the device. Tried again while another holds it."""
        if now < self._next_try:
            return
        self._next_try = now + _AGAIN_S
        try:
            if self._wire.kind == "serial":
                self._device = _serial(self._wire)
            else:
                self._place = _udp(self._wire.local)
        except OSError as error:
            self._tell(f"{why}, and {self._wire.words} cannot be had: {error.strerror or error}")
            if self._beside is None and self._to is not None:
                self._beside = _udp()
            return
        self._tell(f"{why}: speaking in its place on {self._wire.words}")

    def _read_socket(self, sock: socket.socket) -> Iterator[bytes]:
        for _ in range(_AT_A_TIME):
            try:
                data, sender = sock.recvfrom(_DATAGRAM_BYTES)
            except OSError:
                return
            if sender == self._to or self._is_vehicle(data, sender):
                yield data

    def _is_vehicle(self, data: bytes, sender: Address) -> bool:
        """One that was never heard may speak from anywhere; one that was, from another port of its own computer."""
        if self._to is not None and sender[0] != self._to[0]:
            return False
        speaks = any(f.sysid == self._system and f.compid == _AUTOPILOT for f in cut(data).frames)
        if speaks and self._wire.kind == "udpin":
            self._to = sender
        return speaks

    def _read_device(self) -> Iterator[bytes]:
        try:
            data = os.read(self._device.fileno(), 1 << 14)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:  # unplugged: open it again when it is back
            self._device.close()
            self._device = None
            return
        buffer, found = self._stream.feed(data)
        for frame in found.frames:
            yield buffer[frame.start : frame.end]

    def _tell(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self._say(f"{self._name}: {text}")


def _udp(address: Address | None = None) -> socket.socket:
    """Raises OSError when another holds the address."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        made.bind(address or ("0.0.0.0", 0))
    except OSError:
        made.close()
        raise
    return made


def _serial(wire: Wire) -> Any:
    """The device, raw. Raises OSError."""
    import termios

    import serial

    try:
        device = serial.Serial(wire.device, wire.baud, timeout=0, write_timeout=0, exclusive=True)
        os.set_blocking(device.fileno(), False)
        attributes = termios.tcgetattr(device.fileno())
        attributes[6][termios.VMIN] = 1  # a read of nothing then means that it has hung up
        termios.tcsetattr(device.fileno(), termios.TCSANOW, attributes)
    except (serial.SerialException, termios.error, ValueError) as error:
        raise OSError(str(error)) from error
    return device
