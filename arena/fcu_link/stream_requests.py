"""Requests for telemetry streams that the autopilot does not send at the required rate. Pure.

PX4 selects its streams by the profile of the port, and the profile of a telemetry port has few messages. Only
one request is pending at a time, because an acknowledgement does not name the requested message.
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
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 10.0,  # for the preflight checks of the captured attitude
}
_RADIO = {mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 2.0}
# For logs and `sen.imu`: requested on connections that are fast enough.
_WIDE = {
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 30.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
}
WIDE_BAUD = 400_000
_MEASURE_S = 2.0
_MIN_RATE_SHARE = 0.6
_ACK_TIMEOUT_S = 0.5
_TRIES = 5
_RETRY_S, _RETRY_REFUSED_S = 10.0, 30.0


@dataclass(kw_only=True)
class _Stream:
    """Required and measured rate of one telemetry message.

    hz: required rate
    since, count: start [s] and number of messages of the current measurement
    rate_hz, slow: result of the last measurement
    tries: number of requests without a reply
    reported: the user was informed that the autopilot does not send at this rate
    changed: the required rate has changed since the last request
    next: earliest time of the next request [s]
    """

    hz: float
    since: float
    count: int = 0
    rate_hz: float = 0.0
    slow: bool = False
    tries: int = 0
    reported: bool = False
    changed: bool = False
    next: float = -math.inf


class StreamRequests:
    """Measures the rates of telemetry streams, and requests the required rate of each slow stream.

    Pass every received message id to `on_message`. Call `due` a few times a second, and send the request that
    it returns.
    wide: the connection is fast enough for messages that only logs need
    radio: the vehicle needs an RC transmitter, so its RC channels are requested
    """

    def __init__(self, *, wide: bool, radio: bool = False) -> None:
        self._hz = _NEEDED | (_RADIO if radio else {}) | (_WIDE if wide else {})
        self._usual_hz = dict(self._hz)
        self._streams: dict[int, _Stream] = {}
        self._pending: tuple[int, float] | None = None
        self.events: list[str] = []

    def restart(self) -> None:
        """Measure the rates of all streams again after a reboot or reconnection of the vehicle."""
        self._streams.clear()
        self._pending = None

    def set_rate(self, msgid: int, hz: float | None) -> None:
        """Change the required rate of a message [Hz].

        hz: None restores the usual rate, which is required while no axes check runs
        """
        wanted = self._usual_hz[msgid] if hz is None else max(hz, self._usual_hz[msgid])
        if wanted == self._hz[msgid]:
            return
        self._hz[msgid] = wanted
        if msgid in self._streams:
            stream = self._streams[msgid]
            stream.hz, stream.changed, stream.next = wanted, True, -math.inf

    def on_message(self, msgid: int, now: float) -> None:
        stream = self._streams.get(msgid)
        if stream is not None:
            stream.count += 1

    def due(self, now: float) -> tuple[int, float] | None:
        """Return the message id and the interval [us] of the next stream to request; None if no request is due.

        Call it only while the vehicle is connected.
        """
        if not self._streams:
            self._streams = {msgid: _Stream(hz=hz, since=now) for msgid, hz in self._hz.items()}
        for stream in self._streams.values():
            self._measure(stream, now)
        if self._pending is not None:
            if now - self._pending[1] < _ACK_TIMEOUT_S:
                return None
            self._on_timeout(self._pending[0], now)
        return self._request(now)

    def on_ack(self, result: int, now: float) -> None:
        """Process the vehicle's reply (COMMAND_ACK) to the last stream request (SET_MESSAGE_INTERVAL)."""
        if self._pending is None:
            return
        msgid, stream = self._pending[0], self._streams[self._pending[0]]
        self._pending, stream.tries = None, 0
        if result == mavlink.MAV_RESULT_ACCEPTED:
            if stream.rate_hz > 0.0 and stream.next > -math.inf:
                came = f"{_name(msgid)} is received at {stream.rate_hz:.1f} Hz, requested {stream.hz:g} Hz"
                self._report(stream, f"{came}: is the connection too slow?")
            stream.next, stream.since, stream.count, stream.slow = now + _RETRY_S, now, 0, False
            stream.changed = False
            return
        self._report(stream, f"{_name(msgid)} at {stream.hz:g} Hz was refused ({result_words(result)})")
        stream.next, stream.changed = now + _RETRY_REFUSED_S, False

    def _measure(self, stream: _Stream, now: float) -> None:
        length = max(_MEASURE_S, 3.0 / stream.hz)
        if now - stream.since >= length:
            stream.rate_hz = stream.count / (now - stream.since)
            stream.slow = stream.rate_hz < _MIN_RATE_SHARE * stream.hz
            stream.since, stream.count = now, 0

    def _request(self, now: float) -> tuple[int, float] | None:
        for msgid, stream in self._streams.items():
            if (stream.slow or stream.changed) and now >= stream.next:
                self._pending = msgid, now
                stream.tries += 1
                return msgid, 1e6 / stream.hz
        return None

    def _on_timeout(self, msgid: int, now: float) -> None:
        stream, self._pending = self._streams[msgid], None
        if stream.tries >= _TRIES:
            self._report(stream, f"no answer to {_TRIES} requests for {_name(msgid)} at {stream.hz:g} Hz")
            stream.tries, stream.next = 0, now + _RETRY_REFUSED_S

    def _report(self, stream: _Stream, text: str) -> None:
        if not stream.reported:
            stream.reported = True
            self.events.append(text)


def _name(msgid: int) -> str:
    return str(mavlink.mavlink_map[msgid].msgname)
