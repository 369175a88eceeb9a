"""A NatNet client: handshake, body names, frames of the wanted bodies. Never blocks; survives any bytes, and counts them."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

from arena.capture.pose import CapturedFrame, pose_ned
from arena.errors import InputError, WireError
from arena.wire import natnet

_RETRY_S = 0.5
_SILENT_S = 2.0  # no frames for so long: shake hands anew, the server may have been restarted
_KEEPALIVE_S = 1.0
_MOST_PER_POLL = 64
_CONNECT = natnet.packet(natnet.CONNECT, b"Ping\0")
_MODELS = natnet.packet(natnet.REQUEST_MODELDEF)
_KEEPALIVE = natnet.packet(natnet.KEEPALIVE)


class NatNetReceiver:
    """The protocol without its sockets. bodies: names wanted, None for all. counts: what was heard and what was not understood."""

    def __init__(self, bodies: list[str] | None) -> None:
        self._wanted_names = None if bodies is None else set(bodies)
        self._version: natnet.Version | None = None
        self._names: dict[int, str] = {}
        self.counts: Counter[str] = Counter()

    @property
    def known(self) -> bool:
        """The handshake is done: version, and a name for every wanted body."""
        complete = bool(self._names) if self._wanted_names is None else self._wanted_names <= {*self._names.values()}
        return self._version is not None and complete

    def ask(self) -> bytes:
        """The request that the handshake stands at."""
        return _CONNECT if self._version is None else _MODELS

    def forget(self) -> None:
        """The server may be another one now."""
        self._version = None

    def hear(self, data: bytes) -> CapturedFrame | None:
        """One packet of the server."""
        try:
            return self._hear(data, natnet.message_of(data))
        except WireError:
            self.counts["malformed"] += 1
            return None

    def _hear(self, data: bytes, message: int) -> CapturedFrame | None:
        if message == natnet.FRAME:
            return self._frame(data)
        if message == natnet.SERVERINFO:
            self._version = natnet.decode_server_info(data).version
        elif message == natnet.MODELDEF and self._version is not None:
            found = natnet.decode_models(data, self._version)
            wanted = self._wanted_names
            self._names = {i: name for i, name in found.items() if wanted is None or name in wanted}
        else:
            self.counts["not for us"] += 1
        return None

    def _frame(self, data: bytes) -> CapturedFrame | None:
        if self._version is None or not self._names:
            self.counts["before the handshake"] += 1
            return None
        frame = natnet.decode_frame(data, self._version, self._names)
        poses, untracked = [], []
        for body in frame.bodies:
            name = self._names[body.streaming_id]
            pose = pose_ned(name, body.position, body.quat_xyzw) if body.tracked else None
            if pose is None:
                untracked.append(name)
            else:
                poses.append(pose)
        self.counts["frames"] += 1
        return CapturedFrame(frame.number, frame.timestamp_s, tuple(poses), tuple(untracked))


class NatNetCapture:
    """The sockets of a NatNetReceiver. Selectable (`fileno`); call `poll` when readable and a few times a second besides."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.core = NatNetReceiver(settings["bodies"])
        self._server, self._port = settings["server"], int(settings["command_port"])
        self._unicast = settings["transport"] == "unicast"
        self._command = _udp(settings["local"], 0)
        self._sockets = [self._command]
        if not self._unicast:
            self._sockets.append(_member(settings["group"], int(settings["data_port"]), settings["local"]))
        self._epoll = select.epoll()
        for s in self._sockets:
            self._epoll.register(s.fileno(), select.EPOLLIN)
        self._asked = self._kept_alive = -1e9
        self._framed = time.monotonic()
        self._shake(self._framed)

    def fileno(self) -> int:
        return self._epoll.fileno()

    @property
    def counts(self) -> Counter[str]:
        return self.core.counts

    def poll(self, now: float) -> list[CapturedFrame]:
        """Frames that have arrived, oldest first. now: the caller's time, not used to pace the handshake: the server is outside."""
        wall = time.monotonic()
        frames = [frame for s in self._sockets for frame in self._read(s)]
        if frames:
            self._framed = wall
        elif wall - self._framed > _SILENT_S:
            self.core.forget()
            self._framed = wall
        self._shake(wall)
        return frames

    def close(self) -> None:
        self._epoll.close()
        for s in self._sockets:
            s.close()

    def _read(self, s: socket.socket) -> list[CapturedFrame]:
        frames = []
        for _ in range(_MOST_PER_POLL):
            try:
                data, sender = s.recvfrom(65535)
            except OSError:
                break
            if sender[0] != self._server:
                self.counts["foreign"] += 1
            elif (frame := self.core.hear(data)) is not None:
                frames.append(frame)
        return frames

    def _shake(self, wall: float) -> None:
        if not self.core.known and wall - self._asked >= _RETRY_S:
            self._asked = wall
            self._send(self.core.ask())
        if self._unicast and wall - self._kept_alive >= _KEEPALIVE_S:
            self._kept_alive = wall
            self._send(_KEEPALIVE)

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self._command.sendto(data, (self._server, self._port))


def open_capture(settings: Mapping[str, Any]) -> NatNetCapture:
    """A receiver for the `capture` object of a slice. Raises InputError when its sockets cannot be opened."""
    if settings.get("kind", "natnet") != "natnet":
        raise InputError(f"motion capture of kind {settings['kind']!r} is not supported yet; natnet is")
    try:
        return NatNetCapture(settings)
    except OSError as error:
        raise InputError(
            f"motion capture: cannot listen on {settings['local']} for {settings['group']}:{settings['data_port']}: {error.strerror}"
        ) from error


def _udp(address: str, port: int) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setblocking(False)
    s.bind((address, port))
    return s


def _member(group: str, port: int, local: str) -> socket.socket:
    """A socket in a multicast group on one interface, bound to the group so that others on the port are not heard."""
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setblocking(False)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    s.bind((group, port))
    s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + socket.inet_aton(local))
    return s
