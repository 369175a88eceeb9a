"""NatNet client without sockets: handshake, names of bodies, and decoding of frames. Pure.

Invalid bytes are counted and dropped; they never raise.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from math import isfinite, nan
from typing import TYPE_CHECKING

from arena.errors import WireError
from arena.kernels.captured_poses import natnet_poses
from arena.kernels.natnet_payload import PayloadReader, message_of, payload_of
from arena.mocap.client.frame_order import FrameOrder
from arena.mocap.client.pose import CapturedFrame, Echo
from arena.mocap.natnet import codec, echo

if TYPE_CHECKING:
    from arena.kernels.natnet_payload import RawBody, RawFrame

_CONNECT = codec.packet(codec.CONNECT, b"Ping\0")
_MAX_ECHOES, _MAX_ECHO_NUMBER = 8, 1 << 32  # unanswered echo requests that are remembered
_REQUEST_MODELS = codec.packet(codec.REQUEST_MODELDEF)
_FRAME = codec.packet(codec.FRAME)[:2]
_NO_NAMES: dict[str, int] = {}
_new = tuple.__new__  # a NamedTuple's constructor costs twice as much


class NatNetReceiver:
    """NatNet client without sockets: makes requests and decodes the server's packets.

    bodies: names of the requested bodies, None for all.
    info: the server's last description of itself, None before the first. answers: number of such descriptions
    received.
    readable_frames: number of frames decoded, including those without a requested body.
    shared_ids: requested body -> its streaming id, if another body of the server's list has the same id.
    shared_ids_in_frame: the same for the last frame in which several bodies had the same id.
    counts: number of frames passed on, and of datagrams dropped for each reason.
    """

    def __init__(self, bodies: list[str] | None) -> None:
        self._wanted_names = None if bodies is None else set(bodies)
        self._version: codec.Version | None = None
        self._layout_known = False
        self._clock_hz = 0
        self._names: dict[int, str] = {}
        self._models: dict[str, str] = {}  # requested body -> its definition
        self._name_counts: Counter[str] = Counter()  # name -> how many of the server's bodies bear it
        self._has_models = False
        self.info: codec.ServerInfo | None = None
        self.answers = self.readable_frames = 0
        self._order = FrameOrder()
        self._changed = False
        self.shared_ids: dict[str, int] = {}
        self.shared_ids_in_frame: dict[str, int] = {}
        self._echo: Echo | None = None
        self._echo_number = 0
        self._echoes_sent: dict[int, float] = {}
        self.counts: Counter[str] = Counter()

    @property
    def is_connected(self) -> bool:
        """Return whether the handshake is complete.

        This means: the NatNet version and a streaming id for every requested body are known.
        """
        complete = (
            bool(self._names) if self._wanted_names is None else self._wanted_names <= {*self._names.values()}
        )
        return self._version is not None and complete

    def next_request(self) -> bytes:
        """Return the request that the client must send next in the handshake with the server."""
        return _CONNECT if self._version is None else _REQUEST_MODELS

    @property
    def version_unsupported(self) -> bool:
        """Return whether the server uses a NatNet version that cannot be decoded."""
        return self.info is not None and not codec.is_supported(self.info.version)

    @property
    def name_counts(self) -> Counter[str]:
        """Return {name: number of bodies with this name}, from the server's last list of bodies."""
        return self._name_counts

    @property
    def has_models(self) -> bool:
        """Return whether the server has sent its list of bodies since the last reset."""
        return self._has_models

    @property
    def wanted(self) -> set[str]:
        """Return the names of the requested bodies; empty if all bodies are requested."""
        return self._wanted_names or set()

    def add_body(self, body: str) -> None:
        """Request one more body. Poses of the bodies requested before continue to arrive.

        The handshake requests the list of bodies again.
        """
        if self._wanted_names is not None:
            self._wanted_names.add(body)

    def reset(self) -> None:
        """Start the handshake again.

        After a restart of the server, a streaming id may belong to another body.
        """
        self._version = None
        self._names, self._models = {}, {}
        self._has_models = False
        self._echo = None
        self._echoes_sent.clear()

    def echo_request(self, now: float) -> bytes:
        """Return an ECHO_REQUEST packet, whose answer contains the time of the server's clock.

        now: time at which the caller sends the request [s].
        """
        self._echo_number = (self._echo_number + 1) % _MAX_ECHO_NUMBER
        self._echoes_sent[self._echo_number] = now
        if len(self._echoes_sent) > _MAX_ECHOES:
            del self._echoes_sent[next(iter(self._echoes_sent))]
        return echo.encode_echo_request(self._echo_number)

    def receive(self, data: bytes, now: float = nan, arrived_s: float | None = None) -> CapturedFrame | None:
        """Decode one packet of the server. Return its poses, or None if it contains no new frame.

        now: time of arrival [s], by the clock of `echo_request`; only answers to echo requests need it
        arrived_s: monotonic time of arrival for the frame [s]; None if unknown
        """
        try:
            if data[:2] == _FRAME:
                return self._frame(payload_of(data, codec.FRAME), arrived_s)
            self._receive(data, message_of(data), now)
        except WireError:
            self.counts["malformed"] += 1
        return None

    def _receive(self, data: bytes, message: int, now: float) -> None:
        """Decode one packet that is not a frame."""
        if message == codec.SERVERINFO:
            self._on_server_info(codec.decode_server_info(data))
        elif message == codec.MODELDEF and self._version is not None:
            self._on_models(codec.decode_models(data, self._version))
        elif message == codec.ECHO_RESPONSE:
            self._on_echo(*echo.decode_echo_response(data), now)
        else:
            self.counts["other message"] += 1

    def _on_echo(self, number: int, ticks: int, now: float) -> None:
        sent = self._echoes_sent.pop(number, None)
        if sent is not None and self._clock_hz and isfinite(now):
            self._echo = Echo(sent, now, ticks / self._clock_hz)
            self.counts["clock comparisons"] += 1

    def _on_server_info(self, info: codec.ServerInfo) -> None:
        self.info = info
        self.answers += 1
        if self.version_unsupported:
            self.counts["version unsupported"] += 1
        else:
            self._version, self._clock_hz = info.version, info.clock_hz
            self._layout_known = codec.has_known_layout(info.version)

    def definition(self, body: str) -> str:
        """Return a fingerprint: a text that changes when a user redefines the rigid body; "" for an unknown body.

        The text is a hash of the markers. If the server describes no markers, it is the name and the
        streaming id.
        """
        return self._models.get(body, "")

    def _on_models(self, found: Sequence[tuple[int, codec.BodyModel]]) -> None:
        """Store the streaming ids of the requested bodies, except bodies with the same name or id as another body."""
        counts = self._name_counts = Counter(model.name for _, model in found)
        ids = Counter(i for i, _ in found)
        self._has_models = True
        if twice := sum(n > 1 for n in counts.values()):
            self.counts["duplicate names"] += twice
        wanted = self._wanted_names
        if wanted and not wanted <= set(counts):
            self.counts["unknown body"] += 1
        requested = [(i, m) for i, m in found if counts[m.name] == 1 and (wanted is None or m.name in wanted)]
        self.shared_ids = {m.name: i for i, m in requested if ids[i] > 1}
        own = {i: m for i, m in requested if ids[i] == 1}
        self._names = {i: m.name for i, m in own.items()}
        self._models = {m.name: _definition(i, m) for i, m in own.items()}

    def _frame(self, payload: bytes, arrived_s: float | None) -> CapturedFrame | None:
        if self._version is None:
            self.counts["before the handshake"] += 1
            return None
        frame = PayloadReader(payload).frame(self._names, self._version, self._layout_known)
        self.readable_frames += 1
        if not self._names:
            self.counts["no wanted body" if self._has_models else "before the handshake"] += 1
            return None
        place = self._order.place(frame[0])
        if place != "new":
            self.counts[place] += 1
        if place == "repeated":
            return None
        if place == "restarted":
            self.reset()
            return None
        was_changed, self._changed = self._changed, bool(frame[4] & codec.MODELS_CHANGED)
        if self._changed and not was_changed:
            # Streaming ids must be requested again; until then no id has a name.
            self._names, self._models = {}, {}
            self.counts["models changed"] += 1
            return None
        self.counts["frames"] += 1
        return self._captured_frame(frame, arrived_s)

    def _captured_frame(self, frame: RawFrame, arrived_s: float | None) -> CapturedFrame:
        number, time_s, exposure_ticks, transmit_ticks, _, bodies = frame
        shared = self._shared_ids(bodies) if len(bodies) > 1 else _NO_NAMES
        poses, untracked, invalid = natnet_poses(bodies, self._names, shared)
        if invalid:
            self.counts["no pose"] += invalid
        sent_s = echo = None
        if self._clock_hz and exposure_ticks:
            time_s, echo = exposure_ticks / self._clock_hz, self._echo
            sent_s = transmit_ticks / self._clock_hz if transmit_ticks else None
        fields = number, time_s, tuple(poses), (*untracked, *shared), sent_s, echo, arrived_s
        return _new(CapturedFrame, fields)

    def _shared_ids(self, bodies: Sequence[RawBody]) -> dict[str, int]:
        """Return {name of requested body: streaming id} for each id that occurs several times in a frame.

        It is not known which of the bodies with this id is the requested one.
        """
        if len({body[0] for body in bodies}) == len(bodies):
            return _NO_NAMES
        ids = Counter(body[0] for body in bodies)
        self.shared_ids_in_frame = {self._names[i]: i for i, n in ids.items() if n > 1}
        self.counts["duplicate ids"] += 1
        return self.shared_ids_in_frame


def _definition(streaming_id: int, model: codec.BodyModel) -> str:
    if model.markers <= 0:
        return f"name {model.name}, id {streaming_id}"
    return f"markers {hashlib.sha256(model.name.encode() + model.definition).hexdigest()[:16]}"
