"""TCP connection of a real flight controller to the simulator, for hardware in the loop (HITL).

The world (the simulator) cannot distinguish this client from PX4 SITL.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections import Counter
from collections.abc import Iterator

from pymavlink.dialects.v20 import common as mavlink

from arena.transport import Address
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, ParsedFrames, Stream

_RETRY_S = 0.5
_REPORT_AFTER = 10  # refused connections
_READ_BYTES = 65536
_MAX_READS = 16


class SimulatorClient:
    """TCP connection from the link process to the simulated world, for hardware in the loop.

    It is open only while the flight controller sends data.

    The world stops a vehicle's motors when this connection closes. So the motors stop when the flight controller is silent.

    greeting: the first bytes sent; the world accepts a controller only after it has sent something
    events: messages for the user; the caller takes them and empties the list
    """

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
        """Connect to the simulated world while `wanted` is true; disconnect while it is false.

        wanted: whether the flight controller is connected to this process.
        """
        if not wanted:
            if self._connected:
                self.events.append(
                    "no data from the flight controller: disconnected from the world until data arrive"
                )
            self.close()
        elif self._socket is None and now >= self._next_try:
            self._next_try = now + _RETRY_S
            self._connect()
        elif self._socket is not None and not self._connected:
            self._finish()

    def read(self) -> Iterator[tuple[Buffer, ParsedFrames]]:
        for _ in range(_MAX_READS):
            if self._socket is None or not self._connected:
                return
            try:
                data = self._socket.recv(_READ_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                return self._on_closed()
            yield self._stream.feed(data)

    def write(self, data: bytes) -> None:
        """Send MAVLink frames to the simulated world. Close the connection if only a part can be sent.

        Half a frame would make the next frame unreadable. If the world does not read, the frames are dropped.
        """
        if self._socket is None or not self._connected:
            return
        try:
            if self._socket.send(data) != len(data):
                self._on_closed()
        except BlockingIOError:
            self._counts["to the simulator: not read"] += 1
        except OSError:
            self._on_closed()

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._connected = None, False

    def _connect(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        number = self._socket.connect_ex(self._address)
        if number not in (0, errno.EINPROGRESS):
            return self._on_refused(number)
        self._finish()

    def _finish(self) -> None:
        assert self._socket is not None
        number = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if number:
            return self._on_refused(number)
        try:
            self._socket.getpeername()
        except OSError:  # still connecting
            return
        self._connected, self._stream, self._refusals = True, Stream(), 0
        self.write(self._greeting)
        self.events.append(f"connected to the world at {self._address[0]}:{self._address[1]}")

    def _on_refused(self, number: int) -> None:
        """Close the socket after a refused connection, so that `tick` tries again.

        The world is not ready or restarts. Ten refusals in a row are reported.
        """
        self.close()
        self._refusals += 1
        if self._refusals == _REPORT_AFTER:
            self.events.append(
                f"cannot reach the world at {self._address[0]}:{self._address[1]}: {os.strerror(number)}"
            )

    def _on_closed(self) -> None:
        self.close()
        self.events.append("the world closed the simulator link; reconnecting")


def controller_greeting(system: int) -> bytes:
    """Return the first bytes to send to the simulated world: a heartbeat of the flight controller.

    system: MAVLink id of the flight controller.
    """
    return Codec(system, AUTOPILOT).pack(
        mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_PX4,
            mavlink.MAV_MODE_FLAG_HIL_ENABLED,
            0,
            mavlink.MAV_STATE_STANDBY,
            3,
        )
    )
