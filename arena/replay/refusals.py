"""Replies to commands that programs and ground stations send to a replayed vehicle. Pure.

A recording cannot be commanded: commands are denied, and other requests are ignored. Both are reported. Requests for data do no harm:
a request for a recorded state message is answered, and a change of a message rate is accepted without effect, because clients
would otherwise repeat it.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence

from arena.authority import COMMANDS, Kind, command_of, pack_reply, parse_request
from arena.authority.requests import COMMAND_LONG
from arena.replay.state_messages import StateMessages
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, Frame, parse_frames, uint_at
from arena.wire.mavlink_minimal import ACCEPTED, REQUEST_MESSAGE, SET_MESSAGE_INTERVAL

_DENIED, _UNSUPPORTED = 2, 3  # MAV_RESULT
_TEXT = "replay: commands have no effect"
_TEXT_PERIOD_S = 5.0


class Refusals:
    """Command handler of all replayed vehicles, which denies commands because the flight is a recording.

    names, ids: name and MAVLink system id of each vehicle.
    counts: kind of request -> number of refused or ignored requests.
    """

    def __init__(self, names: Sequence[str], ids: Sequence[int]) -> None:
        self._names, self.counts = names, Counter[str]()
        self._codecs = [Codec(system, AUTOPILOT) for system in ids]
        self._reported: set[tuple[int, str]] = set()
        self._events: list[str] = []
        self._text_at: dict[tuple[int, int], float] = {}

    def on_datagram(self, vehicle: int, datagram: bytes, state: StateMessages, now: float) -> list[bytes]:
        """Return the replies of a replayed vehicle to the commands in a datagram.

        vehicle: index of the receiver.  state: its recorded state messages.  now: time [s].
        """
        replies = [self._on_frame(vehicle, datagram, at, state, now) for at in parse_frames(datagram).frames]
        return [reply for reply in replies if reply]

    def take_events(self) -> list[str]:
        """Return and remove the new lines for the event log.

        Each kind of refused command is reported once per vehicle.
        """
        found, self._events = self._events, []
        return found

    def _on_frame(self, vehicle: int, data: bytes, at: Frame, state: StateMessages, now: float) -> bytes:
        command = command_of(data, at)
        if command == SET_MESSAGE_INTERVAL:
            return self._ack(vehicle, at, command, ACCEPTED)
        if command == REQUEST_MESSAGE:
            return self._requested(vehicle, data, at, state)
        request = parse_request(data, at)
        if request is None and at.msgid not in COMMANDS:
            return b""
        what = f"command {command}" if request is None else _words(request.kind, request.mode, request.param)
        self.counts[what] += 1
        if (vehicle, what) not in self._reported:
            self._reported.add((vehicle, what))
            done, sender = "refused" if command else "ignored", f"system {at.sysid}, component {at.compid}"
            self._events.append(
                f"{self._names[vehicle]}: {done}: {what} from {sender}. This is a replay: it cannot be commanded"
            )
        if not command:
            return b""
        return self._ack(vehicle, at, command, _DENIED, self._texts(vehicle, at.sysid, now))

    def _requested(self, vehicle: int, data: bytes, at: Frame, state: StateMessages) -> bytes:
        """Reply to MAV_CMD_REQUEST_MESSAGE with the newest recorded message.

        Only state messages, such as HEARTBEAT, can be requested.
        """
        wanted = int(_first_parameter(data, at)) if at.msgid == COMMAND_LONG else -1
        frame = state.newest(vehicle, wanted)
        if frame is None:
            return self._ack(vehicle, at, REQUEST_MESSAGE, _UNSUPPORTED)
        return self._ack(vehicle, at, REQUEST_MESSAGE, ACCEPTED) + frame

    def _ack(self, vehicle: int, at: Frame, command: int, result: int, texts: Sequence[str] = ()) -> bytes:
        return pack_reply(self._codecs[vehicle], command, (at.sysid, at.compid), texts, result)

    def _texts(self, vehicle: int, sender: int, now: float) -> tuple[str, ...]:
        if now < self._text_at.get((vehicle, sender), float("-inf")) + _TEXT_PERIOD_S:
            return ()
        self._text_at[vehicle, sender] = now
        return (_TEXT,)


def _words(kind: Kind, mode: str, param: str) -> str:
    return " ".join(word for word in (str(kind.value), mode, param) if word)


def _first_parameter(data: bytes, at: Frame) -> float:
    """Return param1 of a COMMAND_LONG, such as a message id. Return -1 for a value that cannot be one, such as NaN."""
    (value,) = struct.unpack("<f", uint_at(data, at, 0, 4).to_bytes(4, "little"))
    return float(value) if abs(value) < 1e6 else -1.0
