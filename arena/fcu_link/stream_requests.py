"""Sees that the vehicle's autopilot tells what the arena needs, as often as it does, by asking for what is missing. Pure.

PX4 streams by the profile of the port it hangs on, and a telemetry port's profile is thin. One request is under way at a time,
for an acknowledgement does not say which message it grants.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_minimal import result_words

_NEEDED = {
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 50.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 30.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
}
# What only logs and `sen.imu` and its like show: for wires that carry it.
_WIDE = {
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 30.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
}
WIDE_BAUD = 400_000
_WATCH_S = 2.0
_ENOUGH = 0.6
_ANSWER_S = 0.5
_TRIES = 5
_AGAIN_S, _GIVEN_UP_S = 10.0, 30.0


@dataclass(kw_only=True)
class _Stream:
    """One message. since, count: of the present watch.  rate_hz, slow: of the last.  next: when it may be asked again."""

    hz: float
    since: float
    count: int = 0
    rate_hz: float = 0.0
    slow: bool = False
    tries: int = 0
    told: bool = False
    next: float = -math.inf


class Streams:
    """wide: does the wire carry more than what is needed? Ask `due` a few times a second."""

    def __init__(self, *, wide: bool) -> None:
        self._hz = _NEEDED | (_WIDE if wide else {})
        self._streams: dict[int, _Stream] = {}
        self._asked: tuple[int, float] | None = None
        self.events: list[str] = []

    def restart(self) -> None:
        """The vehicle has started anew, or is heard again: it knows nothing of what was asked."""
        self._streams.clear()
        self._asked = None

    def heard(self, msgid: int, now: float) -> None:
        stream = self._streams.get(msgid)
        if stream is not None:
            stream.count += 1

    def due(self, now: float) -> tuple[int, float] | None:
        """One that is too slow, to be asked for: (message id, interval [us]).

        To be asked only while the vehicle is heard.
        """
        if not self._streams:
            self._streams = {msgid: _Stream(hz=hz, since=now) for msgid, hz in self._hz.items()}
        for stream in self._streams.values():
            self._watch(stream, now)
        if self._asked is not None:
            if now - self._asked[1] < _ANSWER_S:
                return None
            self._unanswered(self._asked[0], now)
        return self._ask(now)

    def answered(self, result: int, now: float) -> None:
        """A COMMAND_ACK of SET_MESSAGE_INTERVAL for us."""
        if self._asked is None:
            return
        msgid, stream = self._asked[0], self._streams[self._asked[0]]
        self._asked, stream.tries = None, 0
        if result == mavlink.MAV_RESULT_ACCEPTED:
            if stream.rate_hz > 0.0 and stream.next > -math.inf:
                came = f"{_name(msgid)} comes at {stream.rate_hz:.1f} Hz and not at {stream.hz:g}"
                self._tell(stream, f"{came}: is the wire too slow?")
            stream.next, stream.since, stream.count, stream.slow = now + _AGAIN_S, now, 0, False
            return
        self._tell(stream, f"it does not give {_name(msgid)} at {stream.hz:g} Hz ({result_words(result)})")
        stream.next = now + _GIVEN_UP_S

    def _watch(self, stream: _Stream, now: float) -> None:
        length = max(_WATCH_S, 3.0 / stream.hz)
        if now - stream.since >= length:
            stream.rate_hz = stream.count / (now - stream.since)
            stream.slow = stream.rate_hz < _ENOUGH * stream.hz
            stream.since, stream.count = now, 0

    def _ask(self, now: float) -> tuple[int, float] | None:
        for msgid, stream in self._streams.items():
            if stream.slow and now >= stream.next:
                self._asked = msgid, now
                stream.tries += 1
                return msgid, 1e6 / stream.hz
        return None

    def _unanswered(self, msgid: int, now: float) -> None:
        stream, self._asked = self._streams[msgid], None
        if stream.tries >= _TRIES:
            self._tell(stream, f"no answer to {_TRIES} requests for {_name(msgid)} at {stream.hz:g} Hz")
            stream.tries, stream.next = 0, now + _GIVEN_UP_S

    def _tell(self, stream: _Stream, text: str) -> None:
        if not stream.told:
            stream.told = True
            self.events.append(text)


def _name(msgid: int) -> str:
    return str(mavlink.mavlink_map[msgid].msgname)
