"""Status of one vehicle (connected, armed, mode, landed), from HEARTBEAT and EXTENDED_SYS_STATE."""

from __future__ import annotations

from dataclasses import dataclass, field

from arena.kernels.ordinary_datagrams import LANDED_STATE
from arena.wire.mavlink_frame import Buffer, Frame, byte_at, uint_at
from arena.wire.mavlink_minimal import ARMED, EXTENDED_SYS_STATE, HEARTBEAT, LANDED_ON_GROUND, LANDED_UNKNOWN
from arena.wire.px4_mode import mode_words

SILENT_AFTER_S = 3.0
_CUSTOM_MODE, _BASE_MODE = 0, 6  # payload offsets

Fact = bool | str | float


@dataclass(kw_only=True)
class VehicleStatus:
    """Status of one vehicle as facts: `connected`, `armed`, `mode`, `landed` and `airborne_s`.

    changed: receives each changed fact as "uav1.armed" -> value; shared by all vehicles of a router
    The fact `armed` of a vehicle that falls silent keeps its last value.
    """

    name: str
    changed: dict[str, Fact]
    _facts: dict[str, Fact] = field(default_factory=dict, init=False)
    _received_at: float | None = field(default=None, init=False)
    _took_off_at: float | None = field(default=None, init=False)
    _airborne_s: float = field(default=0.0, init=False)

    @property
    def armed(self) -> bool:
        return bool(self._facts.get("armed", False))

    @property
    def mode(self) -> str:
        return str(self._facts.get("mode", ""))

    @property
    def ever_connected(self) -> bool:
        return self._received_at is not None

    def on_frame(self, data: Buffer, frame: Frame, now: float) -> None:
        """Update the status from a MAVLink frame of the vehicle's autopilot. now: monotonic [s]."""
        if frame.msgid == HEARTBEAT:
            self._received_at = now
            self._set("connected", True)
            self._set("armed", bool(byte_at(data, frame, _BASE_MODE) & ARMED))
            self._set("mode", mode_words(uint_at(data, frame, _CUSTOM_MODE, 4)))
        elif frame.msgid == EXTENDED_SYS_STATE:
            state = byte_at(data, frame, LANDED_STATE)
            if state != LANDED_UNKNOWN:
                self._on_landed_state(state == LANDED_ON_GROUND, now)

    def tick(self, now: float) -> None:
        """Set `connected` to False if no heartbeat has arrived for `SILENT_AFTER_S`."""
        if self._received_at is not None and now - self._received_at > SILENT_AFTER_S:
            self._set("connected", False)

    def _on_landed_state(self, landed: bool, now: float) -> None:
        """Update `airborne_s`, the total time in the air [s], at each take-off and landing."""
        if landed and self._took_off_at is not None:
            self._airborne_s += now - self._took_off_at
            self._took_off_at = None
            self._set("airborne_s", round(self._airborne_s, 3))
        elif not landed and self._took_off_at is None:
            self._took_off_at = now
            self._set("airborne_s", round(self._airborne_s, 3))
        self._set("landed", landed)

    def _set(self, what: str, value: Fact) -> None:
        if self._facts.get(what) != value:
            self._facts[what] = value
            self.changed[f"{self.name}.{what}"] = value
