"""Sockets of a user program. They receive telemetry and motion capture, and send setpoints and commands.

The sockets are read regularly, and a heartbeat at 1 Hz announces an onboard computer to the vehicle. On the wall clock a
background thread does both. On a simulation clock in lockstep the program's own thread does both while it sleeps on this
clock, because with a second thread flights would not be repeatable. Setpoints are sent only in a call of the user program, so
that the offboard failsafe acts if the program hangs.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock, LockstepClock
from arena.errors import ArenaError, InputError, NotConfirmedError
from arena.transport import Address, open_udp, parse_url, receive_datagrams
from arena.uav.poses import Poses
from arena.uav.receiver import Receiver
from arena.wire.mavlink_codec import Codec
from arena.wire.telemetry import Telemetry

if TYPE_CHECKING:
    from arena.mocap.client import MocapClient

COMPONENT = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
_MIN_REFRESH_S = 0.001
_CHORES_EVERY_S = 0.1
_HEARTBEAT_S = 1.0
_MAX_DATAGRAMS = 2000  # in one poll: a flood must not keep the caller

Capture = Mapping[str, Any] | Sequence[Mapping[str, Any]]


class Connection:
    """Connection of a user program to its vehicle and to motion capture.

    url: "udpin:HOST:PORT" (the vehicle sends first) or "udpout:HOST:PORT".
    system_id: MAV_SYS_ID of the vehicle.
    poses: object that stores the captured poses.
    capture: settings for `arena.mocap.client`; a list if different servers track different bodies; None
    without motion capture.
    receiver: background thread that this connection shares with others; None for a thread of its own.
    """

    def __init__(
        self,
        url: str,
        system_id: int,
        clock: Clock,
        poses: Poses,
        capture: Capture | None = None,
        receiver: Receiver | None = None,
    ) -> None:
        self.telemetry = Telemetry(system_id)
        self.poses = poses
        self.unsent = 0
        self.fault = ""
        self._clock = clock
        self._codec = Codec(system_id, COMPONENT)
        self._socket, self._vehicle = _open(url)
        self._captures = _open_captures(capture, poses.bodies)
        self._receiving, self._sending = threading.Lock(), threading.Lock()
        self._polled = self._polled_at = -1.0
        self._heartbeat_due = 0.0
        self._ending = threading.Event()
        self._receiver = Receiver() if receiver is None else receiver
        self._lockstep = isinstance(clock, LockstepClock) and clock.lockstep
        if isinstance(clock, LockstepClock) and self._lockstep:
            clock.do_while_asleep(self.chores, _CHORES_EVERY_S)
        else:
            self._receiver.add(self.chores)

    def refresh(self) -> None:
        """Read the data that has arrived at the sockets. Do nothing if the sockets were read in the last millisecond or, in
        lockstep, at the present simulation time.
        """
        if self._lockstep:
            if self._clock.now() != self._polled_at:
                self.poll()
        elif time.monotonic() - self._polled > _MIN_REFRESH_S:
            self.poll()

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Send a message to the vehicle.

        Raises NotConfirmedError before the first message from the vehicle, because its address is unknown.
        """
        if self._vehicle is None:
            raise NotConfirmedError(
                "no message from the vehicle has arrived yet, so its address is not known: is the arena up?"
            )
        self.send_to(message, self._vehicle)

    def send_to(self, message: mavlink.MAVLink_message, address: Address) -> None:
        """Send a message to a given address, such as the vehicle's logger."""
        with self._sending:
            data = self._codec.pack(message)
        self._send_frame(data, address)

    def close(self) -> None:
        """Close the sockets. No command is sent, so a vehicle in the air enters its failsafe."""
        self._ending.set()
        self._receiver.remove(self.chores)
        with self._receiving:
            self._socket.close()
            for client in self._captures:
                client.close()

    def poll(self) -> None:
        """Read all sockets: store new telemetry in `telemetry` and new poses in `poses`."""
        with self._receiving:
            if self._ending.is_set():
                return
            self._polled = time.monotonic()
            now = self._polled_at = self._clock.now()
            for datagram, sender in receive_datagrams(self._socket, _MAX_DATAGRAMS):
                if self.telemetry.on_datagram(datagram, now):
                    self._vehicle = sender
            for client in self._captures:
                self._poll_capture(client, now)

    def chores(self) -> None:
        """Receive data, and send the heartbeat if it is due."""
        self.poll()
        now = self._clock.now()
        if self._vehicle is not None and not 0.0 <= self._heartbeat_due - now <= _HEARTBEAT_S:
            self._heartbeat_due = now + _HEARTBEAT_S
            with self._sending:
                data = self._codec.onboard_heartbeat()
            self._send_frame(data, self._vehicle)

    def _send_frame(self, data: bytes, to: Address) -> None:
        try:
            self._socket.sendto(data, to)
        except OSError:  # a full buffer or a network that is away: the vehicle's silence is reported instead
            self.unsent += 1

    def _poll_capture(self, client: MocapClient, now: float) -> None:
        try:
            for frame in client.poll(now):
                for pose in frame.poses:
                    self.poses.receive(pose.body, pose.p_n, pose.q_nb, frame.time_s, now)
        except (ArenaError, OSError) as error:
            self.fault = str(error)


def _open(url: str) -> tuple[socket.socket, Address | None]:
    """Open the program's socket. Return the socket and the vehicle's address; None if only a message of the vehicle will show it.

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


def _open_captures(settings: Capture | None, bodies: Sequence[str]) -> list[MocapClient]:
    """Open a client for each motion-capture server that tracks at least one of the bodies.

    Each body is requested from the first server that has it, so that poses in the axes of two systems are not
    mixed. If there is only one server, all bodies are requested from it.
    """
    from arena.mocap.client import open_client

    each = [{**settings, "bodies": None}] if isinstance(settings, Mapping) else settings or ()
    opened, left = [], list(bodies)
    for one in each:
        wanted = one.get("bodies")
        own = [b for b in left if wanted is None or b in wanted]
        left = [b for b in left if b not in own]
        if own:
            opened.append(open_client({**one, "bodies": own}))
    return opened
