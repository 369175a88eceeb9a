"""Lateness of captured frames, from the server's time stamps and the receiver's clock.

The two clocks have different zeros. The offset (receiver's clock minus server's clock) is limited from both sides:

    offset <= arrival - stamp       no frame arrives before it is sent; the fastest frame gives the least upper limit
    offset >= sent - answered       a server that answers echo requests answers none before it is sent
    offset <= received - answered   and no answer arrives before it is sent

The limits are kept for the whole run. They widen only as fast as two quartz clocks can drift apart, so a queue that
grows slowly is found. A later offset is never accepted only because it lasts. It is accepted if echo requests prove that
the server's clock was set, if the server has restarted, or if the reference is so young that it may be a wrong stamp.
A stamp in the future must not become the reference, because all later frames would look late.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from arena.kernels.capture_types import CapturedFrame, Echo

_INF, _NAN = float("inf"), float("nan")
_SHIFT_COUNT = 9  # stamps in a row that are in the future: the server's clock has been set forward
_PROVEN_S = 2.0  # a reference with which frames have agreed for longer is not given up without proof
_SETTLED_S = 3.0  # before that: all late for so long while not flying
_DRIFT = 2e-4  # between two clocks [s/s]: a quartz clock is wrong by 1e-4 at most
_MAX_PROCESSING_S = 10.0  # between exposure and sending; more is a wrong stamp
_PROOF_COUNT = 2  # echo answers in a row that contradict the limits
_ECHO_ERROR_S = 0.01  # between an event and the reading of a clock that belongs to it
_MAX_ROUND_TRIP_S = 2.0


class Lateness:
    """Measurement of how late the frames of one motion-capture server arrive.

    A frame is late if it takes longer than the fastest frames.

    stale_s: lateness limit [s]. shifts: number of detected changes of the server's clock.
    latency_s: time from the exposure of the last frame to its arrival [s]; nan before the first echo answer.
    """

    def __init__(self, stale_s: float) -> None:
        self._stale_s = stale_s
        self.shifts = 0
        self.reset()

    def reset(self) -> None:
        """Discard the measured offset between the server's clock and the receiver's clock.

        Call this method, for example, if the server has restarted with another clock. The next frame becomes
        the reference.
        """
        self.latency_s = _NAN
        self._low, self._high = -_INF, _INF  # limits of the offset [s]
        self._now = -_INF
        self._early = self._contradictions = 0
        self._late_since = _INF  # time of the first late frame [s]; infinite: the last was not late
        self._prompt_s = 0.0  # time for which frames have agreed with the reference [s]
        self._processing_s = _INF  # shortest time between exposure and sending [s]
        self._echo: Echo | None = None

    @property
    def clock_error_s(self) -> float:
        """Greatest possible error of the estimated clock offset [s]; infinite without an echo reply."""
        return 0.5 * (self._high - self._low)

    def measure_frame(self, frame: CapturedFrame, now: float, flying: bool) -> float:
        """Return how late a received frame is [s].

        The result is computed from the frame's time stamps and the server's replies to echo requests.

        now: time of arrival [s]. flying: true if a vehicle flies.
        """
        if frame.echo is not None and frame.echo is not self._echo:
            self._echo = frame.echo
            self._on_echo(frame.echo, now)
        return self.measure(frame.time_s, now, flying, sent_s=frame.sent_s)

    def measure(self, stamp_s: float, now: float, flying: bool, sent_s: float | None = None) -> float:
        """Return how late a frame with this time stamp is [s]; infinite if the time stamp must be wrong.

        stamp_s: exposure, by the server's clock [s]. sent_s: time of sending, by the server's clock [s].
        now: time of arrival [s]. flying: true if a vehicle flies. The reference is then never replaced because frames are late:
        frames that waited in a queue look like frames of a clock that was set back.
        """
        if not math.isfinite(now - stamp_s):
            return _INF
        sent = stamp_s if sent_s is None else sent_s
        if not 0.0 <= sent - stamp_s <= _MAX_PROCESSING_S:
            sent = stamp_s
        elapsed_s = self._drift(now)
        offset, processing_s = now - sent, sent - stamp_s
        if self._high == _INF:
            self._high, self._processing_s = offset, processing_s
            return 0.0
        transit_s = offset - self._offset()
        if math.isfinite(self._low):
            self.latency_s = transit_s + processing_s
        self._early = self._early + 1 if transit_s < -self._stale_s else 0
        if self._early:
            return self._shift(offset) if self._early >= _SHIFT_COUNT else _INF
        self._processing_s = min(self._processing_s, processing_s)
        late = max(transit_s, 0.0) + processing_s - self._processing_s
        if late <= self._stale_s:
            self._late_since = _INF
            self._prompt_s += min(elapsed_s, 0.1)
            self._high = max(min(self._high, offset), self._low)
            return late
        return self._on_late_frame(offset, late, now, flying)

    def _offset(self) -> float:
        """Return the estimated offset (receiver's clock minus server's clock) [s].

        This is the middle between the lower and the upper limit. Without a lower limit, it is the upper
        limit.
        """
        return 0.5 * (self._low + self._high) if math.isfinite(self._low) else self._high

    def _drift(self, now: float) -> float:
        """Move the limits of the clock offset apart by the drift that is possible since the last call.

        Return the time since the last call [s].
        """
        elapsed_s = now - self._now if math.isfinite(self._now) and now > self._now else 0.0
        self._now = max(self._now, now)
        self._high += _DRIFT * elapsed_s
        self._low -= _DRIFT * elapsed_s
        return elapsed_s

    def _on_late_frame(self, offset: float, late: float, now: float, flying: bool) -> float:
        """Return the lateness of a late frame [s], or 0 if this frame becomes the new reference for lateness.

        The lateness of a frame is relative to a reference frame. The first frame is the reference, and its time stamp
        may be wrong. The reference is replaced if all frames of the last 3 s were late, no vehicle flies, few frames
        have agreed with the reference, and no echo reply was received. offset: arrival minus time of sending, by two
        clocks [s]. late: lateness relative to the reference [s].
        """
        if self._late_since == _INF or flying or self._prompt_s > _PROVEN_S or math.isfinite(self._low):
            self._late_since = now
        return self._shift(offset) if now - self._late_since >= _SETTLED_S else late

    def _shift(self, offset: float) -> float:
        self.shifts += 1
        self._low, self._high = -_INF, offset
        self._early, self._late_since, self._prompt_s = 0, _INF, 0.0
        return 0.0

    def _on_echo(self, echo: Echo, now: float) -> None:
        """Update the limits of the clock offset after a reply of the server to an echo request.

        After `_PROOF_COUNT` replies in a row that contradict the limits, replace the limits.
        """
        sent, received, answered_s = echo
        low, high = sent - answered_s, received - answered_s
        if not 0.0 <= high - low <= _MAX_ROUND_TRIP_S:
            return
        self._drift(now)
        if low > self._high + _ECHO_ERROR_S or high < self._low - _ECHO_ERROR_S:
            self._contradictions += 1
            if self._contradictions >= _PROOF_COUNT:
                self._shift(high)
                self._low, self._contradictions = low, 0
            return
        self._contradictions = 0
        self._low = max(self._low, low)
        self._high = max(min(self._high, high), self._low)
