"""Identity of the vehicle at the other end of a connection: the hardware uid of its autopilot. Pure.

Two vehicles may have the same MAVLink system id, but each autopilot has its own hardware uid, in the message
AUTOPILOT_VERSION: uid2, or uid if uid2 is zero. A vehicle that appears, reconnects, reboots or changes its address must
send its uid before it counts as the vehicle. Until then it receives nothing but the request for the uid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.transport import Source, source_text
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame, byte_at, uint_at
from arena.wire.mavlink_minimal import NO_UID, HardwareUid, parse_hardware_uid

SILENT_S = 3.0  # after this time without data, a vehicle must send its uid again
_REQUEST_S = 0.25
_MAX_CANDIDATES = 8
_MAX_REPORTS = 50
_VERSION, _ACK = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, mavlink.MAVLINK_MSG_ID_COMMAND_ACK
_HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
_OLD_REQUEST = mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES  # PX4 before v1.11


@dataclass(kw_only=True)
class _Candidate:
    """UDP address or serial device that sends as an autopilot, but whose hardware uid is not accepted yet.

    uid: the uid that it has sent; None before
    received_at: time of its last data [s]
    next_request: time at which its uid is requested again [s]
    command: MAV_CMD of the request
    heartbeat: its last HEARTBEAT frame
    """

    received_at: float
    next_request: float
    uid: HardwareUid | None = None
    command: int = _REQUEST
    heartbeat: bytes = b""


class Identity:
    """Accepts data of one autopilot only: the autopilot with the expected hardware uid.

    Pass all received data to `accepts`, and send the requests that `requests` returns.
    system: MAVLink id of the vehicle
    uid: expected uid in hexadecimal digits, or NO_UID; "" until the first contact
    needs_uid: True if an autopilot without a uid must not arm, unless the expected uid is NO_UID from the start
    fixed: True if the expected uid cannot change any more: it was given to the constructor, or `fix` was called
    source: UDP address or serial device of the vehicle; None while no autopilot is accepted
    last_source: last known `source`; None before the first contact
    heartbeat: last HEARTBEAT frame of the vehicle before it was accepted; empty if there was none
    events: messages for the user; the caller takes them and empties the list
    """

    def __init__(
        self, system: int, uid: str = "", last_source: Source | None = None, *, needs_uid: bool = True
    ) -> None:
        self.system, self.uid = system, uid.lower()
        self.fixed = uid != ""
        self._needs_uid = needs_uid and self.uid != NO_UID
        self.source: Source | None = None
        self.last_source = last_source
        self.heartbeat = b""
        self.events: list[str] = []
        self._received_at = 0.0
        self._candidates: dict[Source, _Candidate] = {}
        self._reported: set[str] = set()

    def fix(self) -> None:
        """Prevent changes of the expected hardware uid until the process ends.

        The vehicle has an arm permit or is armed.
        """
        self.fixed = self.fixed or self.uid != ""

    def release(self) -> None:
        """Require the hardware uid again after a reboot, or after the serial device was opened again."""
        self.source = None
        self._candidates.clear()

    def accepts(self, source: Source, data: Buffer, frames: Sequence[Frame], now: float) -> bool:
        """Process received data. Return whether they come from the vehicle.

        now: monotonic [s].
        """
        ours = [f for f in frames if f.sysid == self.system and f.compid == AUTOPILOT]
        if not ours:
            return source == self.source and now - self._received_at <= SILENT_S
        self._on_autopilot(source, now)
        for frame in ours:
            if frame.msgid == _VERSION:
                self._on_uid(source, parse_hardware_uid(data, frame), now)
            elif frame.msgid == _HEARTBEAT and source in self._candidates:
                self._candidates[source].heartbeat = bytes(data[frame.start : frame.end])
            elif frame.msgid == _ACK and source in self._candidates:
                self._on_ack(self._candidates[source], data, frame)
        self._accept_candidate(source, now)
        return source == self.source

    def requests(self, now: float) -> list[tuple[Source, int]]:
        """Return the requests for a hardware uid to send now, as (receiver, MAV_CMD of the request).

        receiver: UDP address or serial device
        """
        found = []
        for source, candidate in self._candidates.items():
            if candidate.uid is None and now >= candidate.next_request and self._is_active(candidate, now):
                candidate.next_request = now + _REQUEST_S
                found.append((source, candidate.command))
        return found

    def has_candidate(self, now: float) -> bool:
        """Return whether an autopilot that is not accepted has sent data in the last 3 s."""
        return any(self._is_active(candidate, now) for candidate in self._candidates.values())

    def problem(self, now: float) -> str:
        """Return why the hardware uid of the autopilot forbids arming; "" if it does not."""
        if self.source is not None and now - self._received_at <= SILENT_S:
            return "no hardware uid: needs `uid: none`" if self._needs_uid and self.uid == NO_UID else ""
        active = [c for c in self._candidates.values() if self._is_active(c, now)]
        if not active:
            return ""
        return "hardware uid not received" if active[-1].uid is None else "another vehicle answers: wrong uid"

    def _is_active(self, candidate: _Candidate, now: float) -> bool:
        return now - candidate.received_at <= SILENT_S

    def _on_autopilot(self, source: Source, now: float) -> None:
        """Record that an autopilot has sent data.

        Its source becomes a candidate if it is new or was silent.
        """
        if source == self.source:
            if now - self._received_at <= SILENT_S:
                self._received_at = now
                return
            self.release()
        candidate = self._candidates.get(source)
        if candidate is not None and self._is_active(candidate, now):
            candidate.received_at = now
            return
        self._candidates = {s: c for s, c in self._candidates.items() if self._is_active(c, now)}
        if len(self._candidates) < _MAX_CANDIDATES:
            self._candidates[source] = _Candidate(received_at=now, next_request=now)

    def _on_uid(self, source: Source, found: HardwareUid, now: float) -> None:
        if source == self.source:
            if self._matches(source, found):
                return
            self.release()
            self._candidates[source] = _Candidate(received_at=now, next_request=now)
        if source in self._candidates:
            self._candidates[source].uid = found

    def _on_ack(self, candidate: _Candidate, data: Buffer, frame: Frame) -> None:
        """Request the uid with another MAV_CMD if the autopilot has refused the present one.

        There are two: PX4 before v1.11 supports the older one only.
        """
        refused = byte_at(data, frame, 2) != mavlink.MAV_RESULT_ACCEPTED
        if refused and uint_at(data, frame, 0, 2) == candidate.command:
            candidate.command = _OLD_REQUEST if candidate.command == _REQUEST else _REQUEST

    def _accept_candidate(self, source: Source, now: float) -> None:
        """Accept a candidate with the expected hardware uid, unless the source accepted before still sends."""
        candidate = self._candidates.get(source)
        if candidate is None or candidate.uid is None:
            return
        found = candidate.uid
        here = self.source is not None and now - self._received_at <= SILENT_S
        if not here and not self.fixed and not self._matches(source, found):
            self._set_expected_uid(found)
        if not self._matches(source, found):
            self._report_stranger(source, found)
        elif not here:
            silent = f", silent for {now - self._received_at:.0f} s" if self.source is not None else ""
            before = (
                f" (before: {source_text(self.last_source)}{silent})" if self.last_source is not None else ""
            )
            if source != self.last_source:
                self.events.append(f"sends from {source_text(source)}{before}")
            self.source = self.last_source = source
            self._received_at = now
            self.heartbeat = candidate.heartbeat
            del self._candidates[source]

    def _matches(self, source: Source, found: HardwareUid) -> bool:
        if self.uid == NO_UID:
            return str(found) == "" and self.last_source in (None, source)
        return found.matches(self.uid)

    def _set_expected_uid(self, found: HardwareUid) -> None:
        """Accept only the autopilot with this hardware uid from now on, and report the uid.

        Call this method only while `fixed` is false.
        """
        before, self.uid = self.uid, str(found) or NO_UID
        self.last_source = None if NO_UID in (before, self.uid) else self.last_source
        if self.uid == NO_UID:
            self.events.append(
                "the autopilot reports no hardware uid (AUTOPILOT_VERSION has zeros), so another vehicle could "
                "take its place. To fly it all the same, set `uid: none` in the YAML"
            )
        else:
            self.events.append(f"hardware uid {self.uid}" + (f" (before: {before})" if before else ""))

    def _report_stranger(self, source: Source, found: HardwareUid) -> None:
        at, instead = source_text(source), str(found) or NO_UID
        if instead == self.uid:
            text = f"at {at}, expected at {source_text(self.last_source)}, and neither reports a hardware uid"
        else:
            text = f"uid {instead} at {at}, expected {self.uid}"
        if text not in self._reported and len(self._reported) < _MAX_REPORTS:
            self._reported.add(text)
            self.events.append(
                f"another vehicle answers with system id {self.system}: {text}. Nothing is sent to it"
            )


def uid_request(system: int, command: int) -> Any:
    """Return the MAVLink message that requests the hardware uid of an autopilot.

    command: MAV_CMD from `Identity.requests`.
    """
    param1 = float(_VERSION if command == _REQUEST else 1)
    return mavlink.MAVLink_command_long_message(system, AUTOPILOT, command, 0, param1, 0, 0, 0, 0, 0, 0)
