"""When a receiver last heard what, so that it can say what is wrong. Pure: times are arguments, monotonic [s]."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Protocol

from arena.mocap.client.diagnosis import Condition
from arena.mocap.client.pose import CapturedFrame
from arena.wire.natnet import ServerInfo

_GRACE_S = 3.0  # a server that has just been asked may still answer
_STREAMING_S = 3.0
_RECENT_S = 5.0  # longer than a silent server is left unasked
_HIDDEN_S = 2.0


class Core(Protocol):
    """What is read of a NatNetReceiver."""

    answers: int
    understood: int
    info: ServerInfo | None
    counts: Counter[str]

    @property
    def refused(self) -> bool: ...

    @property
    def listed(self) -> bool: ...

    @property
    def there(self) -> Counter[str]: ...

    @property
    def wanted(self) -> set[str]: ...


class Watch:
    """wall: now."""

    def __init__(self, wall: float) -> None:
        self._began = wall
        self._answers = self._understood = self._malformed = self._early = 0
        self._answered_at = self._streamed_at = self._garbled_at = self._early_at = (
            self._stranger_at
        ) = -math.inf
        self._streaming_since = wall
        self._stranger = ""
        self._tracked_at: dict[str, float] = {}

    def look(self, core: Core, frames: Sequence[CapturedFrame], wall: float) -> bool:
        """After each poll. frames: what it found. True when frames came that could be read, whoever was in them."""
        if core.answers != self._answers:
            self._answers, self._answered_at = core.answers, wall
        if (malformed := core.counts["malformed"]) != self._malformed:
            self._malformed, self._garbled_at = malformed, wall
        if (early := core.counts["before the handshake"]) != self._early:
            self._early, self._early_at = early, wall
        if core.understood == self._understood:
            return False
        if wall - self._streamed_at > _STREAMING_S:
            self._streaming_since = wall
        self._understood, self._streamed_at = core.understood, wall
        if frames:
            for pose in frames[-1].poses:
                self._tracked_at[pose.body] = wall
        return True

    def stranger(self, address: str, wall: float) -> None:
        """Something came from an address that is not the server's. Of several the first is remembered, until it falls silent."""
        if address == self._stranger or wall - self._stranger_at > _RECENT_S:
            self._stranger, self._stranger_at = address, wall

    def too_early(self, wall: float) -> bool:
        return wall - self._began < _GRACE_S

    def condition(self, core: Core, wall: float, base: Condition) -> Condition:
        """base: what does not change, filled up with what was heard in the last seconds."""
        there = core.there
        wanted = sorted(core.wanted) if core.listed else []
        return Condition(
            server=base.server,
            command_port=base.command_port,
            data_port=base.data_port,
            transport=base.transport,
            group=base.group,
            local=base.local,
            closed=base.closed,
            refused=core.refused,
            answered=core.info if wall - self._answered_at < _RECENT_S else None,
            streaming=wall - self._streamed_at < _STREAMING_S,
            garbled=wall - self._garbled_at < _RECENT_S,
            early=wall - self._early_at < _RECENT_S,
            stranger=self._stranger if wall - self._stranger_at < _RECENT_S else "",
            names=tuple(there),
            missing=[n for n in wanted if not there[n]],
            twice=[n for n in wanted if there[n] > 1],
            hidden=[n for n in wanted if there[n] == 1 and self._hidden(n, wall)],
        )

    def _hidden(self, name: str, wall: float) -> bool:
        return wall - max(self._tracked_at.get(name, -math.inf), self._streaming_since) > _HIDDEN_S
