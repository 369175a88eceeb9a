"""Offset between the clocks of this computer and of the autopilot, from TIMESYNC round trips. Pure.

The autopilot answers a request with tc1 = 0 at once, and does not change its own clock (PX4: mavlink_timesync.cpp).
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

_PERIOD_S = 0.1
_MAX_ROUND_TRIP_S = 1.0


class ClockOffset:
    """Measurement of the offset between the clocks of this computer and of the autopilot.

    Only the fastest round trip is used, because its error is smallest.

    offset_s: this computer's clock minus the autopilot's clock [s]; None before the first answer
    round_trip_s: time from the request to the answer that counts [s]; its half is the largest error of the offset
    """

    def __init__(self) -> None:
        self.offset_s: float | None = None
        self.round_trip_s = math.inf
        self._sent: dict[int, float] = {}
        self._next = -math.inf

    def request(self, now: float) -> Any | None:
        """Return the TIMESYNC request to send now; None if none is due.

        now: time of sending [s].
        """
        if now < self._next:
            return None
        self._next = now + _PERIOD_S
        self._sent = {number: at for number, at in self._sent.items() if now - at <= _MAX_ROUND_TRIP_S}
        number = int(now * 1e9)
        self._sent[number] = now
        return mavlink.MAVLink_timesync_message(0, number)

    def on_timesync(self, m: Any, now: float) -> None:
        """Update the clock offset from the autopilot's reply to a TIMESYNC request.

        Requests, and replies to requests of other programs, are ignored.
        """
        sent = self._sent.pop(m.ts1, None) if m.tc1 > 0 else None
        if sent is not None and now - sent < self.round_trip_s:
            self.round_trip_s = now - sent
            self.offset_s = (sent + now) / 2.0 - m.tc1 / 1e9
