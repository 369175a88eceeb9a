"""Filter for the MAVLink frames to one vehicle: refuses commands of senders that must not command the vehicle now.

Router, hardware link and built-in autopilot use it. Pure: no sockets, no clocks.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from arena.authority.audit import AuditTrail
from arena.authority.authority import Authority
from arena.authority.requests import COMMANDS, SET_MODE, Kind, Request, command_of, parse_request
from arena.authority.roles import Role
from arena.transport import Source
from arena.wire.mavlink_frame import Buffer, Frame
from arena.wire.mavlink_ids import COPILOT, EMERGENCY, GROUND_TOOLS_SYSTEM

TEXT_BYTES = 50
"""Length of one STATUSTEXT."""
_TEXTS_S = 0.5  # a sender gets the text of a refusal again after this time
_EVENTS_S = 10.0  # the same refusal is an event again after this time
_COMMAND_ACK, _STATUSTEXT, _DO_SET_MODE = 77, 253, 176
_ERROR = 3  # MAV_SEVERITY
TEMPORARILY_REJECTED, DENIED = 1, 2
"""MAV_RESULT of a refusal: the sender may repeat the same request; only a new decision of a person can change the refusal."""
_ACK, _TEXT = struct.Struct("<HBBiBB"), struct.Struct("<B50sHB")
_TOOLS = {
    EMERGENCY.system: Role.EMERGENCY,
    COPILOT.system: Role.COPILOT,
    GROUND_TOOLS_SYSTEM: Role.GROUND_STATION,
}


class _Codec(Protocol):
    """Interface of a MAVLink encoder that uses the system and component id of the vehicle's autopilot.

    An example is `arena.wire.mavlink_codec.Codec`.
    """

    def frame(self, msgid: int, payload: bytes) -> bytes: ...


def role_of_tool(system: int) -> Role:
    """Return the role (such as program or ground station) of a client that sends to the router's `tools` port.

    The router has one such UDP port per vehicle, for any MAVLink client on this computer.

    system: MAVLink system id of the sender.
    """
    return _TOOLS.get(system, Role.PROGRAM)


def role_on_link(link: str, system: int, vehicle: int) -> Role:
    """Return the role (such as program or ground station) of a sender on a link of the vehicle's autopilot.

    link: `router`, `vision`, `panic` or `ground`. Every sender on the ground station link is a ground station, whatever its system id is.
    system, vehicle: MAVLink system ids of the sender and of the vehicle.
    """
    if link == "panic":
        return Role.COPILOT if system == COPILOT.system else Role.EMERGENCY
    if link == "ground":
        return Role.GROUND_STATION
    if system in _TOOLS:
        return _TOOLS[system]
    return Role.PROGRAM if system == vehicle else Role.GROUND_STATION


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """Refusal of a command to a vehicle: the reason, and the data for the reply to the sender.

    why: the reason, as text for the user. command: MAV_CMD to acknowledge, 0 if the message has no acknowledgement.
    to: system and component of the sender. texts: texts to send with the acknowledgement.
    """

    why: str
    command: int
    to: tuple[int, int]
    texts: tuple[str, ...] = ()

    def reply(self, codec: _Codec) -> bytes:
        """Return the encoded reply to the sender of the refused command; empty bytes for no reply.

        codec: encoder with the ids of the vehicle's autopilot.
        """
        return pack_reply(codec, self.command, self.to, self.texts, DENIED)


class CommandGate:
    """Filter for the MAVLink frames to one vehicle: refuses commands of senders that must not command the vehicle now.

    Pass each frame whose message id is in `MESSAGES` to `refusal` before it is sent to the vehicle.
    name: name of the vehicle. system: its MAVLink system id. simulated, radio: see `Authority`.
    audit: record of the requests whose `origin` is given.
    """

    def __init__(self, name: str, system: int, *, simulated: bool, radio: bool = True) -> None:
        self.name, self.system, self.simulated = name, system, simulated
        self.authority = Authority(simulated=simulated, radio=radio)
        self.audit = AuditTrail(name)
        self.refused = 0
        self._text_at: dict[tuple[Role, tuple[int, int]], float] = {}
        self._reported: dict[str, float] = {}
        self._events: list[str] = []
        self._facts: dict[str, Any] = {}

    def refusal(
        self, role: Role, data: Buffer, frame: Frame, now: float, origin: Source = "", *, sent: bool = True
    ) -> Refusal | None:
        """Return the refusal of a frame; None if the frame may be sent to the vehicle.

        now: time of one clock [s]. origin: address of the sender or name of its link, for `audit`; "" records nothing.
        sent: the frame is sent to the vehicle if it is not refused here.
        """
        request = parse_request(data, frame)
        if request is None:
            return None
        why = self.authority.refusal(role, request, now, sent=sent)
        if origin:
            self.audit.add(role, (frame.sysid, frame.compid), request, why, origin, now)
        if not why:
            return None
        return self._refuse(role, request, why, data, frame, now)

    def _refuse(
        self, role: Role, request: Request, why: str, data: Buffer, frame: Frame, now: float
    ) -> Refusal:
        self.refused += 1
        to = frame.sysid, frame.compid
        if request.kind in (Kind.SETPOINT, Kind.MANUAL_INPUT):
            return Refusal(why=why, command=0, to=to)
        self._report(role, request, why, now)
        command = command_of(data, frame) if frame.msgid in COMMANDS else 0
        command = _DO_SET_MODE if frame.msgid == SET_MODE else command
        texts = (why,) if now - self._text_at.get((role, to), -_TEXTS_S) >= _TEXTS_S else ()
        if texts:
            self._text_at = {sender: at for sender, at in self._text_at.items() if now - at < _TEXTS_S}
            self._text_at[role, to] = now
        return Refusal(why=why, command=command, to=to, texts=texts)

    def _report(self, role: Role, request: Request, why: str, now: float) -> None:
        what = f"mode {request.mode}" if request.kind is Kind.MODE else request.kind.value
        text = f"{what} requested by {role.words} refused: {why}"
        if now - self._reported.get(text, -_EVENTS_S) >= _EVENTS_S:
            self._reported = {t: at for t, at in self._reported.items() if now - at < _EVENTS_S}
            self._reported[text] = now
            self._events.append(text)

    def on_state(self, armed: bool, mode: str, now: float) -> None:
        """Process the arming state and mode from a heartbeat of the vehicle's autopilot. now: monotonic [s]."""
        self.authority.on_state(armed, mode, now)

    def on_request(self, request: Mapping[str, Any], now: float) -> None:
        """Process a request of the supervisor: refuse arming, release the vehicle, or restore refusals after a restart.

        Requests for other vehicles are ignored.

        request: see `process_context`
        """
        if request.get("vehicle", self.name) != self.name:
            return
        if request.get("do") == "refuse_arming":
            self.authority.refuse_arming(str(request.get("why", "the run is ending")))
        elif request.get("do") == "release":
            self.authority.release(str(request.get("by", "the operator")), now)
        elif request.get("do") == "restore":
            self.authority.restore(request["standing"], now)

    @property
    def has_news(self) -> bool:
        """True if `events` would return at least one line for the event log."""
        return bool(self._events) or self.authority.has_changes

    def events(self) -> list[str]:
        """Return lines for the event log since the last call, such as `uav1: pilot has control: POSCTL`."""
        found = [*map(str, self.authority.take_changes()), *self._events]
        self._events.clear()
        return [f"{self.name}: {text}" for text in found]

    def changed_facts(self, place: str = "") -> dict[str, Any]:
        """Return the values for the supervisor, such as who has control, that have changed since the last call.

        VEHICLE.control: role that commands the vehicle. VEHICLE.blocked: why programs must not command the vehicle.
        VEHICLE.standing: refusals that must survive a restart of the process (see `Authority.standing`).

        place: "" in the router, `_at_link` in the hardware link. It is appended to the names `blocked` and `standing`, because
        router and link each have their own refusals.
        """
        holder = self.authority.holder
        now = {
            f"{self.name}.control": holder.words if holder else "",
            f"{self.name}.blocked{place}": self.authority.blocked,
            f"{self.name}.standing{place}": self.authority.standing,
        }
        changed = {name: value for name, value in now.items() if value != self._facts.get(name)}
        self._facts = now
        return changed


def pack_reply(codec: _Codec, command: int, to: tuple[int, int], texts: Sequence[str], result: int) -> bytes:
    """Encode the reply to a refused command: a STATUSTEXT for each of `texts`, then COMMAND_ACK.

    codec: encodes in the name of the autopilot. command: MAV_CMD, 0 for no acknowledgement.
    to: system and component of the sender. texts: most severe first; empty if they were sent a moment ago.
    result: MAV_RESULT, TEMPORARILY_REJECTED or DENIED.
    The texts are sent first, so that a client has them when it reads the acknowledgement. The most severe
    text is sent last.
    """
    parts = [
        codec.frame(_STATUSTEXT, _TEXT.pack(_ERROR, text.encode()[:TEXT_BYTES], 0, 0))
        for text in reversed(texts)
    ]
    if command:
        parts.append(codec.frame(_COMMAND_ACK, _ACK.pack(command, result, 0, 0, *to)))
    return b"".join(parts)
