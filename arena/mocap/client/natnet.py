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

from arena.errors import InputError, WireError
from arena.mocap.client.diagnosis import Condition, sentence
from arena.mocap.client.frame_order import FrameOrder
from arena.mocap.client.pose import CapturedFrame, pose_ned
from arena.mocap.client.reception import Watch
from arena.mocap.client.sockets import local_for, member, udp
from arena.wire import natnet

_RETRY_S = 0.5
_SILENT_S = 2.0  # no frames for so long: shake hands anew, the server may have been restarted
_KEEPALIVE_S = 1.0
_TRY_S = 1.0  # between tries to open sockets while there is no network
_UNHEARD_S = 1.0  # a unicast server silent for so long after the handshake may be streaming to the data port
_MOST_PER_POLL = (
    256  # more than a socket's default buffer holds: what is left must not be older than what was read
)
_CONNECT = natnet.packet(natnet.CONNECT, b"Ping\0")
_MODELS = natnet.packet(natnet.REQUEST_MODELDEF)
_KEEPALIVE = natnet.packet(natnet.KEEPALIVE)


class NatNetReceiver:
    """The protocol without its sockets. bodies: names wanted, None for all.

    counts: what was heard, and what not understood; info: what the server last said of itself; answers: how often;
    understood: frames that could be read, whoever was in them.
    """

    def __init__(self, bodies: list[str] | None) -> None:
        self._wanted_names = None if bodies is None else set(bodies)
        self._version: natnet.Version | None = None
        self._clock_hz = 0
        self._names: dict[int, str] = {}
        self._there: Counter[str] = Counter()  # how many bodies bear each of the server's names
        self._listed = False
        self.info: natnet.ServerInfo | None = None
        self.answers = self.understood = 0
        self._order = FrameOrder()
        self._changed = False
        self.counts: Counter[str] = Counter()

    @property
    def known(self) -> bool:
        """The handshake is done: version, and a name for every wanted body."""
        complete = (
            bool(self._names) if self._wanted_names is None else self._wanted_names <= {*self._names.values()}
        )
        return self._version is not None and complete

    def ask(self) -> bytes:
        """The request that the handshake stands at."""
        return _CONNECT if self._version is None else _MODELS

    @property
    def refused(self) -> bool:
        """The server speaks a version that is not understood."""
        return self.info is not None and not natnet.is_understood(self.info.version)

    @property
    def there(self) -> Counter[str]:
        """The server's bodies, by its last list: name -> how many bear it."""
        return self._there

    @property
    def listed(self) -> bool:
        """The server has told its bodies since it was last forgotten."""
        return self._listed

    @property
    def wanted(self) -> set[str]:
        """Names asked for; empty when all are."""
        return self._wanted_names or set()

    def forget(self) -> None:
        """The server may be another one now, and another body may have each streaming id."""
        self._version = None
        self._names = {}
        self._listed = False

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
            self._meet(natnet.decode_server_info(data))
        elif message == natnet.MODELDEF and self._version is not None:
            self._learn(natnet.decode_models(data, self._version))
        else:
            self.counts["not for us"] += 1
        return None

    def _meet(self, info: natnet.ServerInfo) -> None:
        self.info = info
        self.answers += 1
        if self.refused:
            self.counts["version not understood"] += 1
        else:
            self._version, self._clock_hz = info.version, info.clock_hz

    def _learn(self, found: Mapping[int, str]) -> None:
        """A name that two bodies bear says of neither where it is."""
        bearers = self._there = Counter(found.values())
        self._listed = True
        if twice := sum(n > 1 for n in bearers.values()):
            self.counts["names borne twice"] += twice
        wanted = self._wanted_names
        if wanted and not wanted <= set(bearers):
            self.counts["unknown body"] += 1
        self._names = {i: n for i, n in found.items() if bearers[n] == 1 and (wanted is None or n in wanted)}

    def _frame(self, data: bytes) -> CapturedFrame | None:
        if self._version is None:
            self.counts["before the handshake"] += 1
            return None
        frame = natnet.decode_frame(data, self._version, self._names)
        self.understood += 1
        if not self._names:
            self.counts["no wanted body" if self._listed else "before the handshake"] += 1
            return None
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
        exposed = (
            frame.exposure_ticks / self._clock_hz
            if self._clock_hz and frame.exposure_ticks
            else frame.timestamp_s
        )
        return CapturedFrame(frame.number, exposed, tuple(poses), tuple(untracked))


class NatNetCapture:
    """The sockets of a NatNetReceiver. Selectable (`fileno`); call `poll` when readable and a few times a second besides.

    Without a network they are opened when it comes: until then `poll` gives nothing and `trouble` says why.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.core = NatNetReceiver(settings["bodies"])
        self._server, self._port = socket.gethostbyname(settings["server"]), int(settings["command_port"])
        self._wish, self._data_port = settings.get("local"), int(settings["data_port"])
        self._unicast, self._group = settings["transport"] == "unicast", settings["group"]
        self._epoll = select.epoll()
        self._command: socket.socket | None = None
        self._sockets: list[socket.socket] = []
        self._local, self._closed = "", ""
        self._asked = self._kept_alive = self._tried = -math.inf
        self._question = b""
        self._answers_then = self._frames_then = 0
        self._framed = self._opened = time.monotonic()
        self._watch = Watch(self._framed)
        self._open(self._framed)
        self._shake(self._framed)

    def fileno(self) -> int:
        return self._epoll.fileno()

    @property
    def counts(self) -> Counter[str]:
        return self.core.counts

    def poll(self, now: float) -> list[CapturedFrame]:
        """Frames that have arrived, oldest first. now: the caller's time; the handshake keeps to the wall's."""
        wall = time.monotonic()
        if self._command is None:
            self._open(wall)
        frames = [frame for s in self._sockets for frame in self._read(s, wall)]
        if self._watch.look(self.core, frames, wall):
            self._framed = wall
        elif wall - self._framed > _SILENT_S:
            self._silent(wall)
        if (
            self._unicast
            and self.core.counts["frames"] == self._frames_then
            and wall - self._opened > _UNHEARD_S
        ):
            self._opened = math.inf
            self._listen_on_the_data_port()
        self._shake(wall)
        return frames

    def trouble(self) -> str:
        """Why poses do not come, in a sentence; "" when they do, or when it is too early to tell. Ask about once a second."""
        wall = time.monotonic()
        if not self._closed and self._watch.too_early(wall):
            return ""
        transport = "unicast" if self._unicast else "multicast"
        base = Condition(
            server=self._server,
            command_port=self._port,
            data_port=self._data_port,
            transport=transport,
            group=self._group,
            local=self._local,
            closed=self._closed,
        )
        return sentence(self._watch.condition(self.core, wall, base))

    def close(self) -> None:
        self._close()
        self._epoll.close()

    def _open(self, wall: float) -> None:
        """Try, at most once a second."""
        if wall - self._tried < _TRY_S:
            return
        self._tried = wall
        try:
            self._local = self._wish or local_for(self._server, self._port)
            self._command = self._listen(udp(self._local, 0))
            if not self._unicast:
                self._listen(member(self._group, self._data_port, self._local))
        except OSError as error:
            self._close()
            self._closed = f"{self._wish or 'no interface of this computer leads there'}: {error.strerror}"
            self.counts["no network"] += 1
        else:
            self._closed = ""
            self._framed = self._opened = wall
            self._asked = -math.inf
            self._frames_then = self.core.counts["frames"]

    def _listen(self, s: socket.socket) -> socket.socket:
        self._sockets.append(s)
        self._epoll.register(s.fileno(), select.EPOLLIN)
        return s

    def _close(self) -> None:
        for s in self._sockets:
            s.close()
        self._sockets, self._command = [], None

    def _silent(self, wall: float) -> None:
        """The server may have been restarted, or the network: everything anew, on whichever interface leads there now."""
        if self._command is not None:
            self.counts["no frames" if self.core.known else "silences"] += 1
        self.core.forget()
        self._close()
        self._open(wall)
        self._framed = wall

    def _read(self, s: socket.socket, wall: float) -> list[CapturedFrame]:
        frames = []
        for _ in range(_MOST_PER_POLL):
            try:
                data, sender = s.recvfrom(65535)
            except OSError:
                break
            if sender[0] != self._server:
                self.counts["foreign"] += 1
                self._watch.stranger(sender[0], wall)
            elif (frame := self.core.hear(data)) is not None:
                frames.append(frame)
        return frames

    def _listen_on_the_data_port(self) -> None:
        """Not from the start: of several receivers on one computer only the last to bind it would hear anything there."""
        with contextlib.suppress(OSError):
            self._listen(udp(self._local, self._data_port))

    def _shake(self, wall: float) -> None:
        question = b"" if self.core.known else self.core.ask()
        # A new question is asked at once: no pose passes before its answer.
        if question and (question != self._question or wall - self._asked >= _RETRY_S):
            if (
                question == self._question
                and self._answers_then == self.core.answers
                and self._command is not None
            ):
                self.counts["no answer"] += 1
            self._asked, self._answers_then = wall, self.core.answers
            self._send(question)
        self._question = question
        if self._unicast and wall - self._kept_alive >= _KEEPALIVE_S:
            self._kept_alive = wall
            self._send(_KEEPALIVE)

    def _send(self, data: bytes) -> None:
        if self._command is None:
            return
        try:
            self._command.sendto(data, (self._server, self._port))
        except OSError:
            self.counts["not sent"] += 1


def open_capture(settings: Mapping[str, Any]) -> NatNetCapture:
    """A receiver for the `capture` object of a slice. Raises InputError when its sockets cannot be opened."""
    if settings.get("kind", "natnet") != "natnet":
        raise InputError(f"motion capture of kind {settings['kind']!r} is not supported yet; natnet is")
    try:
        return NatNetCapture(settings)
    except socket.gaierror as error:
        raise InputError(
            f"motion capture: the server {settings['server']!r} has no address: {error.strerror}"
        ) from error
