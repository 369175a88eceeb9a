"""Sockets of a user program. They receive telemetry and motion capture, and send setpoints and commands.

The sockets are read regularly, and a heartbeat at 1 Hz announces an onboard computer to the vehicle. On the wall clock a
background thread does both. On a simulation clock in lockstep the program's own thread does both while it sleeps on this
clock, because with a second thread flights would not be repeatable. Setpoints are sent only in a call of the user program, so
that the offboard failsafe acts if the program hangs.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from collections import deque

from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock, LockstepClock
from arena.datagrams import read_datagrams
from arena.errors import InputError, NotConfirmedError, RunError
from arena.transport import Address, open_udp, parse_url
from arena.uav.backend import Backend, BackendName, Command, MavlinkBackend, Wire
from arena.uav.measurements import Measurements
from arena.uav.poses import Poses
from arena.uav.receiver import Receiver
from arena.uav.shared_capture import Capture
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import PROGRAM_COMPONENT
from arena.wire.telemetry import Telemetry

_MIN_REFRESH_S = 0.001
_CHORES_EVERY_S = 0.1
_RECENT_S = 0.09  # less than the time between two calls of `chores`, so that every call is needed if nothing else reads
_HEARTBEAT_S = 1.0
_MAX_DATAGRAMS = 2000  # in one poll: a flood must not keep the caller


class Connection:
    """Connection of a user program to its vehicle and to motion capture.

    url: "udpin:HOST:PORT" (the vehicle sends first) or "udpout:HOST:PORT".
    system_id: MAV_SYS_ID of the vehicle.
    poses: object that stores the captured poses.
    capture: settings for `arena.mocap.client`; None without motion capture.
    relative: object that stores the measurements of the emulated relative sensors; None: they are ignored.
    receiver: background thread and motion capture clients that this connection shares with others; None for its own.
    backend: library that sends setpoints and commands.

    The attribute `setpoint_at` is the time of the last setpoint that was sent [s], -inf before the first one.
    """

    def __init__(
        self,
        url: str,
        system_id: int,
        clock: Clock,
        poses: Poses,
        capture: Capture | None = None,
        receiver: Receiver | None = None,
        backend: BackendName = "mavlink",
        relative: Measurements | None = None,
    ) -> None:
        self.telemetry = Telemetry(system_id)
        self.poses = poses
        self._relative = relative
        self.unsent, self.setpoint_at = 0, -math.inf
        self._clock = clock
        self._codec = Codec(system_id, PROGRAM_COMPONENT)
        self.url = url
        self._socket, self._vehicle = _open(url)
        self._receiver = Receiver() if receiver is None else receiver
        self._capture = (
            None
            if capture is None or poses.body is None
            else self._receiver.capture.open(capture, poses.body, poses)
        )
        self._receiving, self._sending = threading.Lock(), threading.Lock()
        self._received: deque[tuple[bytes, Address]] = deque()
        self._polled = self._polled_at = -1.0
        self._heartbeat_due = 0.0
        self._closed = False
        self._error: Exception | None = None  # of the background thread; the next `refresh` raises it
        self._backend = _open_backend(
            backend,
            Wire(
                system_id=system_id,
                telemetry=self.telemetry,
                send=self.send,
                send_payload=self._send_payload,
            ),
        )
        self._lockstep = isinstance(clock, LockstepClock) and clock.lockstep
        if isinstance(clock, LockstepClock) and self._lockstep:
            clock.do_while_asleep(self.chores, _CHORES_EVERY_S, self.needs_chores)
        else:
            self._receiver.add(self._chores_in_background)

    @property
    def fault(self) -> str:
        """Return why the motion capture client failed; "" if it did not."""
        return "" if self._capture is None else self._capture.fault

    def refresh(self) -> None:
        """Read the data that has arrived at the sockets.

        Do nothing if the sockets were read in the last millisecond or, in lockstep, at the present simulation time.
        Raises RunError once if the background thread could not process received data.
        """
        error, self._error = self._error, None
        if isinstance(error, RunError):  # the world has ended
            raise error
        if error is not None:
            raise RunError(
                f"{self.url}: received data could not be processed: {type(error).__name__}: {error}"
            ) from error
        if self._lockstep:
            if self._clock.now() != self._polled_at:
                self.poll()
        elif time.monotonic() - self._polled > _MIN_REFRESH_S:
            self.poll()

    def send_setpoint(self, message: mavlink.MAVLink_message) -> None:
        """Send a setpoint through the backend (pymavlink or MAVSDK).

        Raises NotConfirmedError before the first message from the vehicle, and after `close`.
        """
        self._known_vehicle()
        self.setpoint_at = self._clock.now()
        self._backend.send_setpoint(message)

    def command(self, number: int) -> Command:
        """Return a command to the autopilot, made by the backend (pymavlink or MAVSDK). It is not sent yet.

        number: MAV_CMD. Raises NotConfirmedError as `send` does.
        """
        self._known_vehicle()
        return self._backend.command(number)

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Send a MAVLink message to the vehicle directly, not through the backend.

        Raises NotConfirmedError before the first message from the vehicle, because its address is unknown.
        """
        self.send_to(message, self._known_vehicle())

    def send_to(self, message: mavlink.MAVLink_message, address: Address) -> None:
        """Send a message to a given address, such as the recorder's address."""
        with self._sending:
            data = self._codec.pack(message)
        self._send_frame(data, address)

    def close(self) -> None:
        """Close the sockets without sending a command.

        A vehicle in the air then enters its offboard loss failsafe.
        """
        self._closed = True
        self._receiver.remove(self._chores_in_background)
        with (
            self._receiving
        ):  # a library that gets a datagram after its end ends the process, with all its vehicles
            self._backend.close()
            self._socket.close()
            if self._capture is not None:
                self._capture.remove(self.poses)

    def poll(self) -> None:
        """Read all sockets. Store new telemetry in `telemetry` and new poses in `poses`."""
        with self._receiving:
            if self._closed:
                return
            now = self._polled_at = self._clock.now()
            self._received.extend(read_datagrams(self._socket, _MAX_DATAGRAMS))
            while self._received:  # after an exception the next call processes the datagrams that are left
                datagram, sender = self._received.popleft()
                if self.telemetry.on_datagram(datagram, now):
                    self._vehicle = sender
                    self._backend.receive(datagram)
                elif self._relative is not None:
                    self._relative.on_datagram(datagram, now)
            if self._capture is not None:
                self._capture.poll(now, once=self._lockstep)
            # last, because `refresh` must wait for a thread that has not stored its data yet
            self._polled = time.monotonic()

    def chores(self) -> None:
        """Receive data, and send the program's heartbeat to the vehicle if it is due."""
        self.poll()
        now = self._clock.now()
        if self._vehicle is not None and self._is_heartbeat_due(now):
            self._heartbeat_due = now + _HEARTBEAT_S
            with self._sending:
                data = self._codec.onboard_heartbeat()
            self._send_frame(data, self._vehicle)

    def _chores_in_background(self) -> None:
        """Call `chores` in the background thread. Keep an exception for the program, so that the thread serves other vehicles."""
        try:
            self.chores()
        except Exception as error:
            self._error = error

    def needs_chores(self, at: float) -> bool:
        """Return whether `chores` is needed at a time [s]: the heartbeat is due, or the sockets were not read shortly before.

        A program that sends setpoints reads the sockets for each of them. It need not wake in between to read them.
        """
        return not 0.0 <= at - self._polled_at < _RECENT_S or self._is_heartbeat_due(at)

    def _is_heartbeat_due(self, at: float) -> bool:
        return not 0.0 <= self._heartbeat_due - at <= _HEARTBEAT_S

    def _known_vehicle(self) -> Address:
        if self._closed:
            raise NotConfirmedError("the connection to the vehicle is closed")
        if self._vehicle is None:
            raise NotConfirmedError(
                "no message from the vehicle has arrived yet, so its address is not known: is the arena up?"
            )
        return self._vehicle

    def _send_payload(self, msgid: int, payload: bytes) -> None:
        """Send an encoded MAVLink payload to the vehicle. Threads of backends may call this method, too."""
        if self._vehicle is not None and not self._closed:
            with self._sending:
                data = self._codec.frame(msgid, payload)
            self._send_frame(data, self._vehicle)

    def _send_frame(self, data: bytes, to: Address) -> None:
        try:
            self._socket.sendto(data, to)
        except OSError:  # a full buffer or a network that is away: the vehicle's silence is reported instead
            self.unsent += 1


def _open(url: str) -> tuple[socket.socket, Address | None]:
    """Open the program's socket. Return the socket and the vehicle's address, or None if the address is unknown.

    The first message of the vehicle then shows its address.

    Raises InputError.
    """
    try:
        connection = parse_url(url)
    except ValueError:
        connection = None
    if connection is None or connection.kind == "serial":
        raise InputError(
            f"link: got {url!r}, expected udpin:HOST:PORT or udpout:HOST:PORT, as in udpin:127.0.0.1:16001"
        )
    if connection.kind == "udpout":
        return open_udp(), connection.address
    try:
        return open_udp(connection.address), None
    except OSError as error:
        where = f"{connection.host}:{connection.port}"
        raise InputError(
            f"link: cannot listen on {where}: {error.strerror}. Does another program use this port?"
        ) from error


def _open_backend(name: BackendName, wire: Wire) -> Backend:
    """Return the backend with this name. Raises NotInstalledError if its library is not installed."""
    if name == "mavsdk":
        from arena.uav.mavsdk_backend import MavsdkBackend  # loads a library of 19 MB

        return MavsdkBackend(wire)
    return MavlinkBackend(wire)
