"""Record of what a motion-capture client has received and when, for its diagnosis.

Pure: every time is an argument, monotonic [s].
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from arena.mocap.client.pose import CapturedFrame

STREAMING_S = 3.0  # frames within this time: the server streams
RECENT_S = 5.0  # longer than the pause between two requests to a silent server
_GRACE_S = 3.0  # a server that has just been asked may still answer
_HIDDEN_S = 2.0


@dataclass(frozen=True, kw_only=True)
class BodyStatus:
    """Requested bodies that have no pose, as one list per cause.

    names: names of all bodies of the server.
    missing: requested bodies that the server does not have.
    duplicate: requested names that two bodies of the server have.
    shared_ids: requested body -> its id on the server, if another body has the same id.
    hidden: requested bodies that were not tracked for 2 s.
    """

    names: Collection[str] = ()
    missing: Sequence[str] = ()
    duplicate: Sequence[str] = ()
    shared_ids: Mapping[str, int] = field(default_factory=dict)
    hidden: Sequence[str] = ()


class Reception:
    """Times at which a client last received each kind of data, such as frames.

    started: time at which the client was opened [s].
    """

    def __init__(self, started: float) -> None:
        self._started = self._streaming_since = started
        self._counts: dict[str, int] = {}
        self._changed_at: dict[str, float] = {}
        self._tracked_at: dict[str, float] = {}
        self._foreign_address, self._foreign_at = "", -math.inf

    def update(self, event: str, count: int, now: float) -> bool:
        """Store the count of an event, such as received frames. Return True if the count has changed.

        event: name of the event, such as "frames". count: number of these events since the client was opened.
        """
        if count == self._counts.get(event, 0):
            return False
        self._counts[event], self._changed_at[event] = count, now
        return True

    def recent(self, event: str, now: float, within_s: float = RECENT_S) -> bool:
        """Return whether an event, such as a received frame, has happened in the last `within_s` seconds."""
        return now - self._changed_at.get(event, -math.inf) < within_s

    def update_frames(self, readable: int, frames: Sequence[CapturedFrame], now: float) -> bool:
        """Record the frames that one `poll` has returned. Return True if at least one new frame was decoded.

        readable: number of frames decoded since the start, including frames without a requested body.
        frames: frames returned by this poll.
        """
        was_streaming = self.streaming(now)
        if not self.update("frames", readable, now):
            return False
        if not was_streaming:
            self._streaming_since = now
        if frames:
            for pose in frames[-1].poses:
                self._tracked_at[pose.body] = now
        return True

    def streaming(self, now: float) -> bool:
        return now - self._changed_at.get("frames", -math.inf) <= STREAMING_S

    def on_foreign(self, address: str, now: float) -> None:
        """Record that a datagram came from an address that is not the server's address.

        If several such addresses send, the first address is kept until it is silent.
        """
        if address == self._foreign_address or now - self._foreign_at > RECENT_S:
            self._foreign_address, self._foreign_at = address, now

    def foreign_address(self, now: float) -> str:
        """Return the last address, other than the server's, that sent a datagram recently; "" if none."""
        return self._foreign_address if now - self._foreign_at < RECENT_S else ""

    def too_early(self, now: float) -> bool:
        """Return whether it is too early for a diagnosis: the client was opened less than 3 s ago.

        The first answer of the server may still arrive.
        """
        return now - self._started < _GRACE_S

    def body_status(
        self,
        served: Counter[str],
        wanted: Collection[str],
        now: float,
        shared_ids: Mapping[str, int] | None = None,
    ) -> BodyStatus:
        """Return the requested bodies that have no pose, grouped by cause.

        served: name -> number of bodies of the server with this name. wanted: names of the requested bodies.
        shared_ids: body -> its id on the server, if another body has the same id.
        """
        return BodyStatus(
            names=tuple(served),
            missing=[n for n in wanted if not served[n]],
            duplicate=[n for n in wanted if served[n] > 1],
            shared_ids={n: i for n, i in (shared_ids or {}).items() if n in wanted},
            hidden=[n for n in wanted if served[n] == 1 and self._hidden(n, now)],
        )

    def _hidden(self, name: str, now: float) -> bool:
        return now - max(self._tracked_at.get(name, -math.inf), self._streaming_since) > _HIDDEN_S
