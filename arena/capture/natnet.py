"""A NatNet client: handshake, body names, frames of the wanted bodies. Never blocks; survives any bytes, and counts them."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

from arena.capture.order import FrameOrder
from arena.capture.pose import CapturedFrame, pose_ned
from arena.errors import InputError, WireError
from arena.wire import natnet

_RETRY_S = 0.5
_SILENT_S = 2.0  # no frames for so long: shake hands anew, the server may have been restarted
_KEEPALIVE_S = 1.0
_UNHEARD_S = 1.0  # a unicast server silent for so long after the handshake may be streaming to the data port
_MOST_PER_POLL = 256  # more than a socket's default buffer holds: what is left must not be older than what was read
_CONNECT = natnet.packet(natnet.CONNECT, b"Ping\0")
_MODELS = natnet.packet(natnet.REQUEST_MODELDEF)
_KEEPALIVE = natnet.packet(natnet.KEEPALIVE)


class NatNetReceiver:
    """The protocol without its sockets. bodies: names wanted, None for all. counts: what was heard, and what not understood."""

    def __init__(self, bodies: list[str] | None) -> None:
        self._wanted_names = None if bodies is None else set(bodies)
        self._version: natnet.Version | None = None
        self._clock_hz = 0
        self._names: dict[int, str] = {}
        self._order = FrameOrder()
        self._changed = False
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
        """The server may be another one now, and another body may have each streaming id."""
        self._version = None
        self._names = {}

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
            info = natnet.decode_server_info(data)
            self._version, self._clock_hz = info.version, info.clock_hz
        elif message == natnet.MODELDEF and self._version is not None:
            self._learn(natnet.decode_models(data, self._version))
        else:
            self.counts["not for us"] += 1
        return None

    def _learn(self, found: Mapping[int, str]) -> None:
        """A name that two bodies bear says of neither where it is."""
        bearers = Counter(found.values())
        if twice := sum(n > 1 for n in bearers.values()):
            self.counts["names borne twice"] += twice
        wanted = self._wanted_names
        self._names = {i: n for i, n in found.items() if bearers[n] == 1 and (wanted is None or n in wanted)}

    def _frame(self, data: bytes) -> CapturedFrame | None:
        if self._version is None or not self._names:
            self.counts["before the handshake"] += 1
            return None
        frame = natnet.decode_frame(data, self._version, self._names)
        place = self._order.place(frame.number)
        if place != "new":
            self.counts[place] += 1
        if place == "repeated":
            return None
        if place == "restarted":
            self.forget()
            return None
        changed, self._changed = frame.models_changed and not self._changed, frame.models_changed
        if changed:
            # Whose streaming id is whose must be asked again; until then nobody's pose is known.
            self._names = {}
            self.counts["models changed"] += 1
            return None
        self.counts["frames"] += 1
        return self._captured(frame)

    def _captured(self, frame: natnet.Frame) -> CapturedFrame:
        poses, untracked = [], []
        for body in frame.bodies:
            name = self._names[body.streaming_id]
            pose = pose_ned(name, body.position, body.quat_xyzw) if body.tracked else None
            if pose is None:
                untracked.append(name)
                if body.tracked:
                    self.counts["no pose"] += 1
            else:
                poses.append(pose)
        exposed = frame.exposure_ticks / self._clock_hz if self._clock_hz and frame.exposure_ticks else frame.timestamp_s
        return CapturedFrame(frame.number, exposed, tuple(poses), tuple(untracked))


class NatNetCapture:
    """The sockets of a NatNetReceiver. Selectable (`fileno`); call `poll` when readable and a few times a second besides."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.core = NatNetReceiver(settings["bodies"])
        self._server, self._port = socket.gethostbyname(settings["server"]), int(settings["command_port"])
        self._local, self._data_port = str(settings["local"]), int(settings["data_port"])
        self._unicast = settings["transport"] == "unicast"
        self._command = _udp(settings["local"], 0)
        self._sockets = [self._command]
        if not self._unicast:
            self._sockets.append(_member(settings["group"], self._data_port, self._local))
        self._epoll = select.epoll()
        for s in self._sockets:
            self._epoll.register(s.fileno(), select.EPOLLIN)
        self._asked = self._kept_alive = -1e9
        self._question = b""
        self._framed = self._opened = time.monotonic()
        self._shake(self._framed)

    def fileno(self) -> int:
        return self._epoll.fileno()

    @property
    def counts(self) -> Counter[str]:
        return self.core.counts

    def poll(self, now: float) -> list[CapturedFrame]:
        """Frames that have arrived, oldest first. now: the caller's time; the handshake keeps to the wall's."""
        wall = time.monotonic()
        frames = [frame for s in self._sockets for frame in self._read(s)]
        if frames:
            self._framed = wall
        elif wall - self._framed > _SILENT_S:
            self.core.forget()
            self._framed = wall
        if self._unicast and not self.core.counts["frames"] and wall - self._opened > _UNHEARD_S:
            self._opened = math.inf
            self._listen_on_the_data_port()
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

    def _listen_on_the_data_port(self) -> None:
        """Not from the start: of several receivers on one computer only the last to bind it would hear anything there."""
        with contextlib.suppress(OSError):
            s = _udp(self._local, self._data_port)
            self._sockets.append(s)
            self._epoll.register(s.fileno(), select.EPOLLIN)

    def _shake(self, wall: float) -> None:
        question = b"" if self.core.known else self.core.ask()
        # A new question is asked at once: no pose passes before its answer.
        if question and (question != self._question or wall - self._asked >= _RETRY_S):
            self._asked = wall
            self._send(question)
        self._question = question
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
            f"motion capture: cannot listen on {settings['local']} for {settings['group']}:{settings['data_port']}: "
            f"{error.strerror}"
        ) from error


def _udp(address: str, port: int) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setblocking(False)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1 if port else 0)
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
