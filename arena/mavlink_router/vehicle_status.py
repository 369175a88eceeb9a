"""What a vehicle says of itself in the two messages the router peeks into: HEARTBEAT and EXTENDED_SYS_STATE."""

from __future__ import annotations

from dataclasses import dataclass, field

from arena.wire.mavlink_frame import Buffer, Frame, byte_at, uint_at
from arena.wire.px4_mode import mode_words

HEARTBEAT, EXTENDED_SYS_STATE, AUTOPILOT = 0, 245, 1
SILENT_AFTER_S = 3.0
_ARMED_BIT = 128
_CUSTOM_MODE, _BASE_MODE, _LANDED_STATE = 0, 6, 1  # payload offsets
_UNDEFINED, _ON_GROUND = 0, 1  # MAV_LANDED_STATE

Fact = bool | str | float


@dataclass(kw_only=True)
class Seen:
    """The facts of one vehicle. A silent vehicle keeps its last `armed`.

    news: where changes are put until they are told, shared by all vehicles of a router.
    """

    name: str
    news: dict[str, Fact]
    _known: dict[str, Fact] = field(default_factory=dict, init=False)
    _heard_at: float | None = field(default=None, init=False)
    _off_ground_at: float | None = field(default=None, init=False)
    _airborne_s: float = field(default=0.0, init=False)

    @property
    def armed(self) -> bool:
        return bool(self._known.get("armed", False))

    @property
    def ever_heard(self) -> bool:
        return self._heard_at is not None

    def hear(self, data: Buffer, frame: Frame, now: float) -> None:
        """A frame of the vehicle's autopilot. now: monotonic [s]."""
        if frame.msgid == HEARTBEAT:
            self._heard_at = now
            self._learn("connected", True)
            self._learn("armed", bool(byte_at(data, frame, _BASE_MODE) & _ARMED_BIT))
            self._learn("mode", mode_words(uint_at(data, frame, _CUSTOM_MODE, 4)))
        elif frame.msgid == EXTENDED_SYS_STATE:
            state = byte_at(data, frame, _LANDED_STATE)
            if state != _UNDEFINED:
                self._land(state == _ON_GROUND, now)

    def tick(self, now: float) -> None:
        if self._heard_at is not None and now - self._heard_at > SILENT_AFTER_S:
            self._learn("connected", False)

    def _land(self, landed: bool, now: float) -> None:
        """`airborne_s`, the time in the air by its own account [s], is told as it leaves and meets the ground."""
        if landed and self._off_ground_at is not None:
            self._airborne_s += now - self._off_ground_at
            self._off_ground_at = None
            self._learn("airborne_s", round(self._airborne_s, 3))
        elif not landed and self._off_ground_at is None:
            self._off_ground_at = now
            self._learn("airborne_s", round(self._airborne_s, 3))
        self._learn("landed", landed)

    def _learn(self, what: str, value: Fact) -> None:
        if self._known.get(what) != value:
            self._known[what] = value
            self.news[f"{self.name}.{what}"] = value
