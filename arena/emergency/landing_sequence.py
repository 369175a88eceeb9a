"""One vehicle brought to the ground, or stopped: bytes and time in, bytes and state out. No sockets, no clocks.

Nothing counts as confirmed but what the autopilot itself said after we began: a HEARTBEAT without the armed bit and, for a
landing, EXTENDED_SYS_STATE on the ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from arena.wire import mavlink_minimal as say
from arena.wire.mavlink_frame import Frame, cut
from arena.wire.px4_mode import AUTO_LAND, mode_words

SYSTEM = 253
RETRY_S = 0.5
ASK_AFTER_S = 1.0
DISARM_AFTER_S = 3.0
WATCH_S = 2.0
"""One that stood all the time is looked at so long: its program may be about to arm it."""
STALE_S = 3.0
"""A mode that was heard so long ago may be another by now: it is commanded again, which does no harm to one that lands."""
_HEARTBEAT_S = 1.0
_FORCE = 21196.0  # MAV_CMD_COMPONENT_ARM_DISARM: stop the motors, flying or not
_AUTOPILOT = 1
_NAN = float("nan")
_WORDS = {say.DO_SET_MODE: "land mode", say.NAV_LAND: "landing", say.ARM_DISARM: "disarming"}
_RESULTS = {
    say.TEMPORARILY_REJECTED: "temporarily rejected",
    say.DENIED: "denied",
    say.UNSUPPORTED: "unsupported",
    say.FAILED: "failed",
    say.CANCELLED: "cancelled",
}

Action = Literal["land", "kill"]


@dataclass(kw_only=True)
class Known:
    """The vehicle's own words since we began; None where it has said nothing. Times are monotonic [s]."""

    heard_at: float | None = None
    armed: bool | None = None
    landed: bool | None = None
    mode: str | None = None
    mode_at: float | None = None
    landed_since: float | None = None
    was_up: bool = False  # armed, or off the ground, at any time since


class Landing:
    """Ask `due` what to send a few times a second, `hear` what comes, look at `confirmed`; `line` tells the end."""

    def __init__(
        self, *, name: str, system: int, component: int, action: Action = "land", now: float
    ) -> None:
        """system: of the vehicle.  component: ours, so that acknowledgements meet us.  now: monotonic [s]."""
        self.name, self.system, self.action = name, system, action
        self.known = Known()
        self.refusal = ""
        self._voice = say.Voice(SYSTEM, component)
        self._component = component
        self._began = self._next_send = self._next_heartbeat = now
        self._confirmed_at: float | None = None

    @property
    def confirmed(self) -> bool:
        return self._confirmed_at is not None

    def settled(self, now: float) -> bool:
        """Confirmed, and nothing more is to be expected of it."""
        return self._confirmed_at is not None and (self.known.was_up or now - self._confirmed_at >= WATCH_S)

    def due(self, now: float) -> list[bytes]:
        """Frames to send now, on every path there is."""
        frames = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + _HEARTBEAT_S
            frames.append(self._voice.heartbeat())
        if now >= self._next_send and not self.confirmed:
            self._next_send = now + RETRY_S
            frames += self._kill() if self.action == "kill" else self._land(now)
        return frames

    def hear(self, data: bytes | memoryview, now: float) -> None:
        """One datagram, whatever it holds."""
        for at in cut(data).frames:
            if at.sysid == self.system and at.compid == _AUTOPILOT:
                self._learn(data, at, now)
        self._judge(now)

    def line(self, now: float) -> str:
        """What is known of this vehicle, in one line."""
        if self._confirmed_at is None:
            return f"{self.name}: NOT CONFIRMED: {self._knowledge(now)}"
        after = f"after {self._confirmed_at - self._began:.1f} s"
        if self.action == "kill":
            return f"{self.name}: motors stopped {after}"
        return (
            f"{self.name}: landed and disarmed {after}"
            if self.known.was_up
            else f"{self.name}: already on the ground"
        )

    def _knowledge(self, now: float) -> str:
        known = self.known
        if known.heard_at is None:
            return "not heard at all"
        words = [f"last heard {now - known.heard_at:.0f} s ago"]
        words.append({None: "armed or not is unknown", True: "armed", False: "disarmed"}[known.armed])
        words.append(
            {None: "in the air or not is unknown", True: "on the ground", False: "in the air"}[known.landed]
        )
        words.append(f"mode {known.mode}" if known.mode else "mode unknown")
        return ", ".join(words + ([self.refusal] if self.refusal else []))

    def _land(self, now: float) -> list[bytes]:
        known, frames = self.known, []
        if known.mode != "AUTO.LAND" or known.mode_at is None or now - known.mode_at > STALE_S:
            main, sub = AUTO_LAND
            frames.append(self._command(say.DO_SET_MODE, say.CUSTOM_MODE, main, sub))
            frames.append(self._command(say.NAV_LAND, 0, 0, 0, _NAN, _NAN, _NAN, _NAN))
        if known.landed_since is not None and known.armed and now - known.landed_since > DISARM_AFTER_S:
            frames.append(self._command(say.ARM_DISARM, 0, 0))
        if now - self._began >= ASK_AFTER_S:
            if known.armed is None:
                frames.append(self._ask(say.HEARTBEAT))
            if known.landed is None:
                frames.append(self._ask(say.EXTENDED_SYS_STATE))
        return frames

    def _kill(self) -> list[bytes]:
        return [self._command(say.ARM_DISARM, 0, _FORCE)]

    def _ask(self, message: int) -> bytes:
        return self._command(say.SET_MESSAGE_INTERVAL, message, 200_000)

    def _command(self, number: int, *params: float) -> bytes:
        return self._voice.command(self.system, _AUTOPILOT, number, *params)

    def _learn(self, data: bytes | memoryview, at: Frame, now: float) -> None:
        known = self.known
        if at.msgid == say.HEARTBEAT:
            beat = say.heartbeat_of(data, at)
            known.armed = bool(beat.base_mode & say.ARMED)
            known.mode, known.mode_at = mode_words(beat.custom_mode), now
        elif at.msgid == say.EXTENDED_SYS_STATE:
            self._learn_landed(say.landed_of(data, at), now)
        elif at.msgid == say.COMMAND_ACK:
            self._learn_answer(say.ack_of(data, at))
        else:
            return
        known.heard_at = now
        known.was_up |= bool(known.armed) or known.landed is False

    def _learn_landed(self, state: int, now: float) -> None:
        if state == say.LANDED_UNKNOWN:
            return
        self.known.landed = state == say.LANDED_ON_GROUND
        if not self.known.landed:
            self.known.landed_since = None
        elif self.known.landed_since is None:
            self.known.landed_since = now

    def _learn_answer(self, ack: say.Ack) -> None:
        system, component = ack.target
        if system not in (0, SYSTEM) or component not in (0, self._component):
            return
        words = _WORDS.get(ack.command)
        if words is None:
            return
        if ack.result == say.ACCEPTED:
            self.refusal = ""
        elif ack.result in _RESULTS:
            self.refusal = f"{words} refused: {_RESULTS[ack.result]}"

    def _judge(self, now: float) -> None:
        known = self.known
        down = known.armed is False and (self.action == "kill" or known.landed is True)
        if not down:
            self._confirmed_at = None
        elif self._confirmed_at is None:
            self._confirmed_at = now
            self._next_send = now
