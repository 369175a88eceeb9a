"""NatNet client: opens UDP sockets for a `NatNetReceiver`, and sends its requests at the right times. Never blocks."""

from __future__ import annotations

import contextlib
import math
import socket
import time
from collections import Counter

from arena.errors import InputError
from arena.mocap.client.pose import CapturedFrame
from arena.mocap.client.reception import Reception
from arena.mocap.client.sockets import ServerSockets
from arena.mocap.natnet import codec
from arena.mocap.natnet.diagnosis import Condition, diagnose
from arena.mocap.natnet.receiver import NatNetReceiver
from arena.mocap.vendors import Settings

_RETRY_S = 0.5
_SILENT_S = 2.0  # without frames for so long: start again, the server or the network may have restarted
_KEEPALIVE_S = 1.0
_COMPARE_CLOCKS_S = 0.2  # often enough to follow the clock of a simulated server that stutters
_NO_UNICAST_S = 1.0  # without frames for so long after opening: a unicast server may stream to the data port
_EVENTS = ("answers", "malformed", "duplicate ids", "early")
_KEEPALIVE = codec.packet(codec.KEEPALIVE)


def open_client(settings: Settings) -> NatNetClient:
    """Open a NatNet client.

    settings: the `capture` object of a process's configuration.

    Raises InputError if the server's name cannot be resolved.
    """
    try:
        return NatNetClient(settings)
    except socket.gaierror as error:
        raise InputError(
            f"motion capture: cannot resolve the server name {settings['server']!r}: {error.strerror}. "
            "Check the name, or give the server's IPv4 address."
        ) from error


class NatNetClient:
    """Client of one NatNet server, which implements the interface `MocapClient`."""

    def __init__(self, settings: Settings) -> None:
        self.core = NatNetReceiver(settings["bodies"])
        self._server, self._port = socket.gethostbyname(settings["server"]), int(settings["command_port"])
        self._data_port = int(settings["data_port"])
        self._unicast, self._group = settings["transport"] == "unicast", settings["group"]
        now = time.monotonic()
        self._reception = Reception(now)
        multicast = None if self._unicast else (self._group, self._data_port)
        self._sockets = ServerSockets(
            (self._server, self._port),
            settings.get("local"),
            multicast,
            self._reception,
            self.counts,
            stamps=bool(settings.get("stamps")),
        )
        self._requested_at = self._kept_alive = self._compared_at = -math.inf
        self._request = b""
        self._answers_at_request = self._frames_at_open = 0
        self._seen = (0, 0, 0, 0)  # counts of `_EVENTS` that are stored in `_reception`
        self._last_frame = self._opened = now
        self._open(now)
        self._advance_handshake(now)

    def fileno(self) -> int:
        return self._sockets.fileno()

    @property
    def counts(self) -> Counter[str]:
        return self.core.counts

    def poll(self, now: float) -> list[CapturedFrame]:
        wall = time.monotonic()
        if not self._sockets.is_open:
            self._open(wall)
        frames, receive = [], self.core.receive
        for data, at in self._sockets.read_stamped(wall):
            frame = receive(data, now, at)
            if frame is not None:
                frames.append(frame)
        counted = self.counts.get  # faster than Counter's way to return 0
        seen = (
            self.core.answers,
            counted("malformed", 0),
            counted("duplicate ids", 0),
            counted("before the handshake", 0),
        )
        if seen != self._seen:
            self._seen = seen
            for event, count in zip(_EVENTS, seen, strict=True):
                self._reception.update(event, count, wall)
        if self._reception.update_frames(self.core.readable_frames, frames, wall):
            self._last_frame = wall
        elif wall - self._last_frame > _SILENT_S:
            self._restart(wall)
        if (
            self._unicast
            and wall - self._opened > _NO_UNICAST_S
            and self.counts["frames"] == self._frames_at_open
        ):
            self._opened = math.inf
            # Not from the start: of several clients on one computer only the last to bind the port receives there.
            with contextlib.suppress(OSError):
                self._sockets.listen_on(self._data_port)
        self._advance_handshake(wall)
        if frames and wall - self._compared_at >= _COMPARE_CLOCKS_S:
            self._compared_at = wall
            self._sockets.send(self.core.echo_request(now))
        return frames

    def add_body(self, body: str) -> None:
        self.core.add_body(body)

    def definition(self, body: str) -> str:
        return self.core.definition(body)

    def refresh_definitions(self) -> None:
        if self.core.is_connected:
            self._sockets.send(self.core.next_request())

    def diagnosis(self) -> str:
        now, seen = time.monotonic(), self._reception
        if not self._sockets.error and seen.too_early(now):
            return ""
        wanted = sorted(self.core.wanted) if self.core.has_models else []
        ids = self.core.shared_ids | (
            self.core.shared_ids_in_frame if seen.recent("duplicate ids", now) else {}
        )
        return diagnose(
            Condition(
                server=self._server,
                command_port=self._port,
                data_port=self._data_port,
                transport="unicast" if self._unicast else "multicast",
                group=self._group,
                local=self._sockets.local,
                no_network=self._sockets.error,
                answered=self.core.info if seen.recent("answers", now) else None,
                version_unsupported=self.core.version_unsupported,
                streaming=seen.streaming(now),
                malformed=seen.recent("malformed", now),
                early=seen.recent("early", now),
                foreign=seen.foreign_address(now),
                bodies=seen.body_status(self.core.name_counts, wanted, now, ids),
            )
        )

    def close(self) -> None:
        self._sockets.close()

    def _open(self, wall: float) -> None:
        if self._sockets.open(wall):
            self._last_frame = self._opened = wall
            self._requested_at = -math.inf
            self._frames_at_open = self.counts["frames"]

    def _restart(self, wall: float) -> None:
        """Open new sockets and start a new handshake, after 2 s without frames.

        The server, the network or the route to the server may have changed. wall: monotonic wall time [s].
        """
        if self._sockets.is_open:
            self.counts["no frames" if self.core.is_connected else "no handshake"] += 1
        self.core.reset()
        self._sockets.close_sockets()
        self._open(wall)
        self._last_frame = wall

    def _advance_handshake(self, wall: float) -> None:
        """Send the next request of the handshake, or repeat it after 0.5 s without an answer.

        wall: monotonic wall time [s].
        """
        request = b"" if self.core.is_connected else self.core.next_request()
        if request and (request != self._request or wall - self._requested_at >= _RETRY_S):
            repeated = request == self._request and self._answers_at_request == self.core.answers
            if repeated and self._sockets.is_open:
                self.counts["no answer"] += 1
            self._requested_at, self._answers_at_request = wall, self.core.answers
            self._sockets.send(request)
        self._request = request
        if self._unicast and wall - self._kept_alive >= _KEEPALIVE_S:
            self._kept_alive = wall
            self._sockets.send(_KEEPALIVE)
