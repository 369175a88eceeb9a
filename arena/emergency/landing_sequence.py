"""Commands that land or stop one vehicle, and confirmation of the landing or stop by telemetry.

Pure: no sockets, no clocks.
Only telemetry received after the start confirms a landing: HEARTBEATs without the armed bit and an
EXTENDED_SYS_STATE with the state on the ground. The HEARTBEATs alone confirm a stop of the motors. They must arrive over
1 s without one that is armed, because a router that was stopped may deliver all its old messages at once. Acknowledgements
and texts only change the texts for the user: another land-all may use the same MAVLink component id, so an
acknowledgement may belong to a command of the other one.
A vehicle of which a pilot takes manual control is not commanded any more (`pilot_watch`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from arena.constants import FORCE_ARM_DISARM, PILOT_HAS_CONTROL
from arena.emergency.pilot_watch import PilotWatch
from arena.wire import mavlink_minimal as mav
from arena.wire.mavlink_frame import AUTOPILOT, Frame, parse_frames
from arena.wire.mavlink_ids import EMERGENCY
from arena.wire.px4_mode import AUTO_LAND, mode_words

RETRY_S = 0.5
REQUEST_AFTER_S = 1.0  # time after which missing telemetry is requested
DISARM_AFTER_S = 3.0  # time on the ground after which an armed vehicle is disarmed
DISARMED_S = 1.0  # the first and the last of the heartbeats that confirm disarming arrive so far apart
PAUSE_S = 2.0  # a vehicle that reports to be landed is not commanded for this time, in which telemetry confirms or denies it
WATCH_S = (
    2.0  # a vehicle that was on the ground from the start is watched this long: its program may arm it now
)
MODE_STALE_S = 3.0  # an older flight mode may have changed since: the land mode is commanded again
TELEMETRY_STALE_S = 1.5
_REASON_S = 2.0  # a text that the autopilot sent within this time before a refusal is its reason
_WARNING = 4  # MAV_SEVERITY of the least severe text that may be the reason of a refusal
_HEARTBEAT_S = 1.0
_NAN = float("nan")
_REQUESTED_INTERVAL_US = 200_000
_COMMAND_WORDS = {mav.DO_SET_MODE: "LAND mode", mav.NAV_LAND: "land command", mav.ARM_DISARM: "disarming"}

Action = Literal["land", "kill"]


@dataclass(kw_only=True)
class ReportedState:
    """State that the vehicle has reported since the start of land-all or kill-all; None if not reported.

    Times are monotonic [s].
    disarmed_since, heartbeat_at: times of the first HEARTBEAT in the present series without the armed bit, and of the last
        HEARTBEAT
    was_up: the vehicle was armed or off the ground at any time since the start
    """

    received_at: float | None = None
    armed: bool | None = None
    landed: bool | None = None
    mode: str | None = None
    mode_at: float | None = None
    heartbeat_at: float | None = None
    disarmed_since: float | None = None
    landed_since: float | None = None
    was_up: bool = False


class LandingSequence:
    """Sequence that lands one vehicle or stops its motors.

    It returns the frames to send and reads the telemetry.

    Send the frames that `due` returns a few times a second, and pass received datagrams to `on_datagram`,
    until `confirmed`.
    system: MAVLink id of the vehicle
    component: MAVLink component id of this process, so that acknowledgements are sent to it
    now: monotonic [s]
    radio: a pilot may have an RC transmitter, see `PilotWatch`
    refusal: text about the last command that the vehicle refused; "" if it accepted the last one
    confirmed: true while telemetry confirms that the vehicle has landed (or that its motors are stopped)
    """

    def __init__(
        self,
        *,
        name: str,
        system: int,
        component: int,
        action: Action = "land",
        now: float,
        radio: bool = True,
    ) -> None:
        self.name, self.system, self.action = name, system, action
        self.reported = ReportedState()
        self.refusal = ""
        self._reason, self._reason_at = "", -_REASON_S
        self._pilot = PilotWatch(radio=radio)
        self._sender = mav.MinimalSender(EMERGENCY.system, component)
        self.component = component
        self._began = self._next_send = self._next_heartbeat = now
        self._down_since: float | None = None
        self.confirmed = False

    @property
    def reported_down(self) -> bool:
        """True if the last reports are those of a landed (or stopped) vehicle, although they may be old."""
        return self._down_since is not None

    def settled(self, now: float) -> bool:
        """Return whether the vehicle is confirmed as landed (or stopped) and was monitored long enough."""
        if self._down_since is None or not self.confirmed:
            return False
        return self.reported.was_up or now - self._down_since >= WATCH_S

    def due(self, now: float) -> list[bytes]:
        """Return the MAVLink frames to send to the vehicle now: heartbeats, landing or kill commands, requests.

        They are for every connection to the vehicle.
        """
        frames = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + _HEARTBEAT_S
            frames.append(self._sender.heartbeat())
        if now >= self._next_send and not self.confirmed:
            self._next_send = now + RETRY_S
            if not self._pilot.has_control(now, self.reported.mode):
                frames += self._kill() if self.action == "kill" else self._land(now)
            if self.action == "land":
                frames += self._missing_telemetry(now)
            if (
                self.reported_down
            ):  # an answer shows whether the report was old, earlier than the next regular one
                frames.append(self._command(mav.REQUEST_MESSAGE, mav.HEARTBEAT))
        return frames

    @property
    def may_bypass(self) -> bool:
        """Return whether `land-all` may command the vehicle directly, without its link process.

        The result is False while a pilot may have control.
        """
        return self._pilot.may_bypass

    def on_refusal(self, data: bytes | memoryview) -> None:
        """Read a datagram of the router or link process, which refuses commands while a pilot has control.

        Refusals for another reason than that a pilot has control are ignored.
        """
        for at in parse_frames(data).frames:
            if at.sysid == self.system and at.msgid == mav.STATUSTEXT:
                _, text = mav.parse_statustext(data, at)
                if text == PILOT_HAS_CONTROL:
                    self._pilot.on_refusal()

    def take_events(self) -> list[str]:
        """Return the texts for the user that are new since the last call: a pilot took manual control, or gave it back."""
        found, self._pilot.events = self._pilot.events, []
        return found

    def on_datagram(self, data: bytes | memoryview, now: float) -> None:
        """Update the reported state from a received datagram. Never raises.

        Frames of other vehicles and components are ignored.
        """
        for at in parse_frames(data).frames:
            if at.sysid == self.system and at.compid == AUTOPILOT:
                self._on_frame(data, at, now)
        self._update_confirmed(now)

    def result_line(self, now: float) -> str:
        """Return one line for the user: landed, stopped, or NOT CONFIRMED with the last reported state."""
        if self._down_since is None or not self.confirmed:
            return f"{self.name}: NOT CONFIRMED: {self._last_state(now)}"
        after = f"after {self._down_since - self._began:.1f} s"
        if self.action == "kill":
            return f"{self.name}: motors stopped {after}"
        if self.reported.was_up:
            return f"{self.name}: landed and disarmed {after}"
        return f"{self.name}: already on the ground"

    def _last_state(self, now: float) -> str:
        reported = self.reported
        if reported.received_at is None:
            return "; ".join(["no telemetry received", *([self.refusal] if self.refusal else [])])
        age_s = now - reported.received_at
        state = ", ".join(
            [
                {None: "arming state unknown", True: "armed", False: "disarmed"}[reported.armed],
                {None: "landed state unknown", True: "on the ground", False: "in the air"}[reported.landed],
                f"mode {reported.mode}" if reported.mode else "mode unknown",
                *([self.refusal] if self.refusal else []),
            ]
        )
        if age_s >= TELEMETRY_STALE_S:
            state = f"no telemetry for {age_s:.0f} s, last state: {state}"
        return f"{self._pilot.words}; {state}" if self._pilot.mode else state

    def _land(self, now: float) -> list[bytes]:
        reported, frames = self.reported, []
        # the land mode would keep a vehicle that has really landed from arming again; one that flies denies it within a heartbeat
        if self._down_since is not None and now - self._down_since < PAUSE_S:
            return []
        if reported.mode != "AUTO.LAND" or reported.mode_at is None or now - reported.mode_at > MODE_STALE_S:
            main, sub = AUTO_LAND
            frames.append(self._command(mav.DO_SET_MODE, mav.CUSTOM_MODE, main, sub))
            frames.append(self._command(mav.NAV_LAND, 0, 0, 0, _NAN, _NAN, _NAN, _NAN))
        landed_since = reported.landed_since
        if landed_since is not None and reported.armed and now - landed_since > DISARM_AFTER_S:
            frames.append(self._command(mav.ARM_DISARM, 0, 0))
        return frames

    def _missing_telemetry(self, now: float) -> list[bytes]:
        """Return requests for those messages that confirm a landing and have not arrived yet.

        These messages are HEARTBEAT and EXTENDED_SYS_STATE.
        """
        if now - self._began < REQUEST_AFTER_S:
            return []
        missing = {mav.HEARTBEAT: self.reported.armed, mav.EXTENDED_SYS_STATE: self.reported.landed}
        return [self._request(message) for message, value in missing.items() if value is None]

    def _kill(self) -> list[bytes]:
        return [self._command(mav.ARM_DISARM, 0, FORCE_ARM_DISARM)]

    def _request(self, message: int) -> bytes:
        return self._command(mav.SET_MESSAGE_INTERVAL, message, _REQUESTED_INTERVAL_US)

    def _command(self, number: int, *params: float) -> bytes:
        return self._sender.command(self.system, AUTOPILOT, number, *params)

    def _on_frame(self, data: bytes | memoryview, at: Frame, now: float) -> None:
        reported = self.reported
        if at.msgid == mav.HEARTBEAT:
            heartbeat = mav.parse_heartbeat(data, at)
            reported.armed = bool(heartbeat.base_mode & mav.ARMED)
            reported.mode, reported.mode_at = mode_words(heartbeat.custom_mode), now
            reported.heartbeat_at = now
            if reported.armed:
                reported.disarmed_since = None
            elif reported.disarmed_since is None:
                reported.disarmed_since = now
            self._pilot.on_heartbeat(reported.armed, reported.mode, now)
        elif at.msgid == mav.EXTENDED_SYS_STATE:
            self._on_landed_state(mav.parse_landed_state(data, at), now)
        else:
            if at.msgid == mav.RC_CHANNELS and mav.parse_channel_count(data, at):
                self._pilot.on_stick_positions(now)
            if at.msgid == mav.STATUSTEXT:
                self._on_text(*mav.parse_statustext(data, at), now)
            elif at.msgid == mav.COMMAND_ACK:
                self._on_ack(mav.parse_ack(data, at), now)
            return
        reported.received_at = now
        reported.was_up |= bool(reported.armed) or reported.landed is False

    def _on_landed_state(self, state: int, now: float) -> None:
        if state == mav.LANDED_UNKNOWN:
            return
        self.reported.landed = state == mav.LANDED_ON_GROUND
        if not self.reported.landed:
            self.reported.landed_since = None
        elif self.reported.landed_since is None:
            self.reported.landed_since = now

    def _on_text(self, severity: int, text: str, now: float) -> None:
        if severity <= _WARNING and text:
            self._reason, self._reason_at = text, now

    def _on_ack(self, ack: mav.AckFields, now: float) -> None:
        system, component = ack.target
        if system not in (0, EMERGENCY.system) or component not in (0, self.component):
            return
        words = _COMMAND_WORDS.get(ack.command)
        if words is None or ack.result == mav.IN_PROGRESS:
            return
        if ack.result == mav.ACCEPTED:
            self.refusal = ""
            return
        refusal = f"{words} refused: {mav.result_words(ack.result)}"
        if now - self._reason_at < _REASON_S:
            self.refusal = f"{refusal} ({self._reason})"
        elif not self.refusal.startswith(refusal):  # the text is not repeated with each acknowledgement
            self.refusal = refusal

    def _update_confirmed(self, now: float) -> None:
        reported = self.reported
        down = reported.armed is False and (self.action == "kill" or reported.landed is True)
        if not down:
            self._down_since, self.confirmed = None, False
            return
        if self._down_since is None:
            self._down_since = self._next_send = now
        if reported.heartbeat_at is not None and reported.disarmed_since is not None:
            self.confirmed = reported.heartbeat_at - reported.disarmed_since >= DISARMED_S
