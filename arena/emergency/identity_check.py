"""Check by the autopilot's hardware uid that a connection leads to the right real vehicle of a run. Pure.

Two vehicles may have the same MAVLink system id. The hardware uid is different for each autopilot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from arena.constants import REORDERED_MS
from arena.transport import Source, source_text
from arena.wire import mavlink_minimal as mav
from arena.wire.mavlink_frame import AUTOPILOT, parse_frames
from arena.wire.mavlink_ids import EMERGENCY

# Times and intervals [s]. After SILENT_S without data, another vehicle may use the same source (a link process waits 3 s).
SILENT_S = 2.0
REQUEST_S = 0.25  # between two requests for the uid, before an answer
REPEAT_S = 1.0  # the same, after the answer of another vehicle
TELEMETRY_S = 0.3  # a recorded source that has sent no telemetry for this time is commanded without its uid
ANSWER_S = 1.0  # the same for a recorded source that sends telemetry, but no uid
_MOST_SOURCES = 16


@dataclass(kw_only=True)
class _SourceState:
    """State of one source of MAVLink data: a UDP address, a serial device or a link process.

    Times are monotonic [s].
    is_vehicle: whether the uid is that of the vehicle; None if it has not been received since the last change
    changed: the source has rebooted, or it was silent, since it was checked
    since, received_at: times of the first and the last data since the last change
    """

    is_vehicle: bool | None = None
    changed: bool = False
    since: float
    received_at: float
    boot_ms: int = 0
    next_request: float = 0.0


class IdentityCheck:
    """Decides by the hardware uid which sources of MAVLink data are connected to the right vehicle.

    A source is a UDP address, a serial device or a link process.
    Only telemetry of a source that has sent the right uid counts. Commands may be sent only to such a source, and to the
    recorded source if the vehicle does not reply. A source that was silent for SILENT_S or has rebooted must
    send its uid again.

    system: MAVLink id of the vehicle
    component: MAVLink component id of this process
    uid: hardware uid of the right vehicle, in hexadecimal digits
    recorded: source that the run has recorded for the vehicle; None if unknown
    say: function that prints a text for the user
    """

    def __init__(
        self,
        *,
        system: int,
        component: int,
        uid: str,
        recorded: Source | None,
        say: Callable[[str], None],
    ) -> None:
        self._system, self._uid, self._recorded, self._say = system, uid, recorded, say
        self._sender = mav.MinimalSender(EMERGENCY.system, component)
        self._sources: dict[Source, _SourceState] = {}
        self._opened_at: float | None = None

    def receive(self, data: bytes, source: Source, now: float) -> bool:
        """Process data from a source. Return whether this source has sent the hardware uid of the right vehicle.

        If it returns False, the telemetry in the data must not be used.
        """
        frames = [f for f in parse_frames(data).frames if f.sysid == self._system and f.compid == AUTOPILOT]
        if not frames:
            return False
        state = self._state(source, now)
        for frame in frames:
            if frame.msgid == mav.SYSTEM_TIME:
                self._on_boot_ms(state, mav.parse_boot_ms(data, frame), now)
            elif frame.msgid == mav.AUTOPILOT_VERSION:
                self._on_uid(source, state, mav.parse_hardware_uid(data, frame))
        return state.is_vehicle is True

    def _may_command(self, source: Source, now: float) -> bool:
        """Return whether commands may be sent to a source now.

        A source that has sent the vehicle's uid may be commanded. A source that has sent another uid may not.
        A source that has sent no uid may be commanded only if it is the recorded source, no other source has sent the
        vehicle's uid, and the time for an answer has passed.
        """
        state = self._sources.get(source)
        if state is not None and state.is_vehicle is not None:
            return state.is_vehicle
        if source != self._recorded or any(s.is_vehicle for s in self._sources.values()):
            return False
        if state is None:
            return self._opened_at is not None and now - self._opened_at >= TELEMETRY_S
        return not state.changed and now - state.since >= ANSWER_S

    def receivers(self, now: float) -> list[Source]:
        """Return the sources to which commands may be sent now.

        Call this method as soon as the connection is opened. If the recorded source sends no telemetry, it may be
        commanded TELEMETRY_S after the first call.
        """
        self._opened_at = now if self._opened_at is None else self._opened_at
        known = dict.fromkeys([*([] if self._recorded is None else [self._recorded]), *self._sources])
        return [source for source in known if self._may_command(source, now)]

    def requests(self, now: float) -> list[tuple[Source, bytes]]:
        """Return the requests for the hardware uid to send now, as (source, MAVLink frame)."""
        found = []
        for source, state in self._sources.items():
            active = source == self._recorded or now - state.received_at < SILENT_S
            if not state.is_vehicle and active and now >= state.next_request:
                state.next_request = now + (REQUEST_S if state.is_vehicle is None else REPEAT_S)
                found.append((source, _pack_request(self._sender, self._system)))
        return found

    def is_other(self, source: Source) -> bool:
        """Return whether a source has sent the uid of another vehicle."""
        state = self._sources.get(source)
        return state is not None and state.is_vehicle is False

    def forget(self, source: Source) -> None:
        """Discard the hardware uid of a source, for example of a serial device that was unplugged.

        The source must then send its uid again.
        """
        if source in self._sources:
            self._require(self._sources[source], self._sources[source].received_at)

    def _state(self, source: Source, now: float) -> _SourceState:
        state = self._sources.get(source)
        if state is None:
            if len(self._sources) >= _MOST_SOURCES:
                unknown = (s for s, found in self._sources.items() if not found.is_vehicle)
                self._sources.pop(next(unknown, next(iter(self._sources))))
            state = self._sources[source] = _SourceState(since=now, received_at=now)
        elif now - state.received_at > SILENT_S:
            self._require(state, now)
        state.received_at = now
        return state

    def _on_boot_ms(self, state: _SourceState, boot_ms: int, now: float) -> None:
        if boot_ms < state.boot_ms - REORDERED_MS:
            self._require(state, now)
        state.boot_ms = boot_ms

    def _require(self, state: _SourceState, now: float) -> None:
        state.is_vehicle, state.changed, state.since, state.boot_ms = None, True, now, 0

    def _on_uid(self, source: Source, state: _SourceState, found: mav.HardwareUid) -> None:
        before, state.is_vehicle = state.is_vehicle, found.matches(self._uid)
        if not state.is_vehicle:
            if before is not False:
                self._say(
                    f"another vehicle replies at {source_text(source)} (hardware uid {found or 'none'}, "
                    f"expected {self._uid}): not commanded"
                )
            return
        # the vehicle has moved: its old source must send the uid again
        for other, one in self._sources.items():
            if other != source and one.is_vehicle:
                self._require(one, one.received_at)


def _pack_request(sender: mav.MinimalSender, system: int) -> bytes:
    """Encode a request for AUTOPILOT_VERSION, which contains the hardware uid."""
    return sender.command(system, AUTOPILOT, mav.REQUEST_MESSAGE, mav.AUTOPILOT_VERSION)
