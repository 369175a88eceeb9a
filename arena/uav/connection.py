"""The sockets of a program: what the autopilot and the cameras say comes in here, what the program says goes out.

A background thread receives and sends the 1 Hz heartbeat that tells the vehicle "a computer is on board". It never sends a
setpoint: those leave in the caller's own call, so that a hung program goes silent and meets the offboard failsafe.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock
from arena.errors import ArenaError, InputError, NotConfirmedError
from arena.transport import Address, open_udp, parse_url, receive_datagrams
from arena.uav.poses import Poses
from arena.wire.mavlink_codec import Codec
from arena.wire.telemetry import Telemetry

if TYPE_CHECKING:
    from arena.mocap.client import MocapClient

COMPONENT = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
_WAKE_S = 0.02  # wall time between looks at the sockets: fifty wake-ups a second instead of six hundred
_FRESH_S = 0.001
_HEARTBEAT_S = 1.0
_MOST = 2000  # datagrams at a look: a flood must not keep the caller


Capture = Mapping[str, Any] | Sequence[Mapping[str, Any]]


class Connection:
    """url: "udpin:HOST:PORT" (wait to be spoken to) or "udpout:HOST:PORT". capture: settings of `arena.mocap.client`, one or several
    where different servers see different bodies, or None.
    """

    def __init__(
        self, url: str, system_id: int, clock: Clock, poses: Poses, capture: Capture | None = None
    ) -> None:
        self.telemetry = Telemetry(system_id)
        self.poses = poses
        self.unsent = 0
        self.fault = ""
        self._clock = clock
        self._codec = Codec(system_id, COMPONENT)
        self._socket, self._partner = _open(url)
        self._captures = _captures(capture, poses.bodies)
        self._receiving, self._sending = threading.Lock(), threading.Lock()
        self._looked = -1.0
        self._heartbeat_due = 0.0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="arena.uav link", daemon=True)
        self._thread.start()

    def refresh(self) -> None:
        """Take in what has arrived, unless that was done in the last millisecond."""
        if time.monotonic() - self._looked > _FRESH_S:
            self._look()

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Raises NotConfirmedError while nobody has spoken here yet, so that there is no address to answer."""
        if self._partner is None:
            raise NotConfirmedError(
                "nothing has been heard on the vehicle's link yet, so there is nobody to send to"
            )
        with self._sending:
            data = self._codec.pack(message)
        self._send_frame(data, self._partner)

    def _send_frame(self, data: bytes, to: Address) -> None:
        try:
            self._socket.sendto(data, to)
        except (
            OSError
        ):  # a full buffer or a network that is away: the silence that follows is what gets reported
            self.unsent += 1

    def close(self) -> None:
        """Nothing is commanded: a vehicle in the air meets its failsafe."""
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)
        with self._receiving:
            self._socket.close()
            for receiver in self._captures:
                receiver.close()

    def _run(self) -> None:
        while not self._ending.wait(_WAKE_S):
            self._look()
            now = self._clock.now()
            if self._partner is not None and not 0.0 <= self._heartbeat_due - now <= _HEARTBEAT_S:
                self._heartbeat_due = now + _HEARTBEAT_S
                with self._sending:
                    data = self._codec.onboard_heartbeat()
                self._send_frame(data, self._partner)

    def _look(self) -> None:
        with self._receiving:
            if self._ending.is_set():
                return
            self._looked = time.monotonic()
            now = self._clock.now()
            self._hear_autopilot(now)
            for receiver in self._captures:
                self._hear_capture(receiver, now)

    def _hear_autopilot(self, now: float) -> None:
        for datagram, sender in receive_datagrams(self._socket, _MOST):
            if self.telemetry.on_datagram(datagram, now):
                self._partner = sender

    def _hear_capture(self, receiver: MocapClient, now: float) -> None:
        try:
            for frame in receiver.poll(now):
                for pose in frame.poses:
                    self.poses.on_pose(pose.body, pose.p_n, pose.q_nb, frame.time_s, now)
        except (ArenaError, OSError) as error:
            self.fault = str(error)


def _open(url: str) -> tuple[socket.socket, Address | None]:
    """Return the program's socket, and the vehicle's address when the URL names it. Raises InputError."""
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
            f"link: cannot listen on {where}: {error.strerror}. Does another program hold it?"
        ) from error


def _captures(settings: Capture | None, bodies: Sequence[str]) -> list[MocapClient]:
    """A receiver for each server that is to see one of the bodies. A body is taken from one server only: the first, so that no
    two systems' axes are mixed. A server that stands alone sees them all.
    """
    from arena.mocap.client import open_client

    each = [{**settings, "bodies": None}] if isinstance(settings, Mapping) else settings or ()
    made, left = [], list(bodies)
    for one in each:
        wanted = one.get("bodies")
        own = [b for b in left if wanted is None or b in wanted]
        left = [b for b in left if b not in own]
        if own:
            made.append(open_client({**one, "bodies": own}))
    return made
