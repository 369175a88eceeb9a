"""Lateness of captured frames: compares the server's time stamp with the receiver's clock. Pure.

The two clocks have different zeros, so lateness is measured relative to the fastest frame so far. Time stamps
may also be wrong. A stamp in the future must not become the reference, because all later frames would look
late and the vehicle would get no poses. A stamp far in the past must not become the reference either, because
old frames from a queue that is emptied after a stall would look new.
"""

from __future__ import annotations

from math import inf, isfinite

_SHIFT_COUNT = 9  # stamps in a row that are in the future: the server's clock has been set forward
_SETTLED_S = 3.0  # all late for so long while not flying: the server's clock has been set back
_DRIFT = 1e-3  # drift between the two clocks [s/s]; a crystal's error is a tenth of it


class Lateness:
    """Measures how late the frames of one motion-capture server arrive.

    stale_s: lateness limit [s]. shifts: number of detected changes of the server's clock.
    """

    def __init__(self, stale_s: float) -> None:
        self._stale_s = stale_s
        self.shifts = 0
        self.reset()

    def reset(self) -> None:
        """Start again with the next frame as reference, for example because the server has restarted with
        another clock.
        """
        self._reference: float | None = None
        self._now = -inf
        self._early = 0
        self._late_since: float | None = None

    def measure(self, stamp_s: float, now: float, flying: bool) -> float:
        """Return how late a frame is [s]; infinite if its time stamp cannot be right.

        stamp_s: the server's time of the frame [s]. now: time of arrival [s].
        flying: if true, no change of the server's clock into the past is accepted, because frames from a full
        queue look the same.
        """
        offset = now - stamp_s
        if not isfinite(offset):
            return inf
        if self._reference is None:
            self._reference, self._now = offset, now
            return 0.0
        self._reference += _DRIFT * min(max(now - self._now, 0.0), 0.1)
        self._now = now
        late = offset - self._reference
        self._early = self._early + 1 if late < -self._stale_s else 0
        if self._early:
            return self._shift(offset) if self._early >= _SHIFT_COUNT else inf
        return self._settle(offset, late, now, flying)

    def _settle(self, offset: float, late: float, now: float, flying: bool) -> float:
        if late <= self._stale_s:
            self._late_since = None
            self._reference = offset - max(late, 0.0)
            return max(late, 0.0)
        self._late_since = now if self._late_since is None or flying else self._late_since
        return self._shift(offset) if now - self._late_since >= _SETTLED_S else late

    def _shift(self, offset: float) -> float:
        self.shifts += 1
        self._reference, self._early, self._late_since = offset, 0, None
        return 0.0
